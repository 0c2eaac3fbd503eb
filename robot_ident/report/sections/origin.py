"""Where all of it comes from: recordings, models, versions, and the commands that give it again."""

from __future__ import annotations

import platform
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from robot_ident import __version__
from robot_ident.diagnosis.staircase import Step
from robot_ident.effects.own import is_own
from robot_ident.recording.measurement import Source
from robot_ident.report.findings import Findings
from robot_ident.report.section import Section, Table
from robot_ident.report.words import joined

_LIBRARIES = ("numpy", "scipy", "pin", "casadi", "plotly")


@dataclass(frozen=True)
class Origin(Section):
    """Hashes, versions, options, commands."""

    found: Findings

    title = "Provenance"
    template = "origin.html.j2"

    def context(self) -> Mapping[str, Any]:
        """Return tables of recordings and models, versions and commands."""
        sources = [(one, "fitted") for one in self.found.training] + [
            (one, "validation") for one in self.found.validation
        ]
        header = ("recording", "as", "samples", "duration [s]", "compared rows")
        rows = [_recording(source, use) for source, use in sources]
        return {
            "recordings": Table(header, rows, numeric=(2, 3)),
            "hashes": [f"{source.sha256}  {source.path}" for source, _ in sources],
            "notes": [f"{source.path}: {note}" for source, _ in sources for note in source.measured.notes],
            "models": [self._model(step) for step in self.found.steps],
            "versions": _versions(),
            "commands": [*(_made_by(step, self.found.effects_from) for step in self.found.steps), self.found.command],
        }

    def _model(self, step: Step) -> dict[str, Any]:
        model, provenance = step.model, step.model.provenance
        here = {source.sha256 for source in self.found.training}
        seen = [one for one in provenance.get("recordings", []) if isinstance(one, Mapping)]
        hashes = {one.get("sha256") for one in seen}
        if not seen:
            fitted = "its recordings are not noted"
        elif hashes == here:
            fitted = "fitted to the recordings above, by their hashes"
        else:
            fitted = "fitted to other recordings: " + joined([str(one.get("path")) for one in seen])
        options = {**{k: v for k, v in model.processing.items() if v not in (None, 1)}, **provenance.get("options", {})}
        return {
            "path": step.path,
            "robot": model.robot.name,
            "made": f"{provenance.get('date', 'no date')}, robot_ident {provenance.get('robot_ident', 'unknown')}",
            "fitted": fitted,
            "effects": ", ".join(model.structure.labels),
            "options": ", ".join(f"{key} {value}" for key, value in options.items()),
        }


def _recording(source: Source, use: str) -> tuple[str, ...]:
    measured, recording = source.measured, source.recording
    rows = f"{measured.motion.samples} of one recording"
    if measured.base_frequency is not None:
        rows = f"{measured.motion.samples}, mean of {measured.periods} periods of {1.0 / measured.base_frequency:.4g} s"
    return (source.path, use, str(recording.samples), f"{recording.duration:.1f}", rows)


def _versions() -> str:
    listed = [f"robot_ident {__version__}", f"Python {platform.python_version()}"]
    for name in _LIBRARIES:
        try:
            listed.append(f"{name} {version(name)}")
        except PackageNotFoundError:
            continue
    return ", ".join(listed)


def _made_by(step: Step, effects_from: Sequence[str]) -> str:
    """Return the command that makes a model again from its recordings; effects_from: files of a user's own effects."""
    provenance, model = step.model.provenance, step.model
    options = provenance.get("options", {})
    words = ["robot_ident", "identify"]
    words += [str(one["path"]) for one in provenance.get("recordings", []) if isinstance(one, Mapping)]
    words += ["--robot", model.robot.name if model.robot.definition is None else f"{model.robot.name}.yaml"]
    words += ["--estimator", model.estimator]
    known = set(type(model.structure).build(model.robot).labels)
    for label in model.structure.labels:
        words += ["--effect", label] if label not in known else []
    if any(is_own(type(effect)) for effect in model.structure.effects):
        words += [word for path in effects_from for word in ("--effects-from", path)]
    words += ["--physical"] if model.physical is not None else []
    for option, key in (("--trajectory", "trajectory"), ("--topic", "topic")):
        words += [option, str(options[key])] if options.get(key) else []
    words += _processing(model.processing, bool(options.get("trajectory")))
    return shlex.join([*words, "-o", step.path])


def _processing(processing: Mapping[str, Any], trajectory: bool) -> list[str]:
    """Return the options of `identify` that ask for a processing."""
    words: list[str] = []
    if processing.get("base_frequency") and not trajectory:
        words += ["--base-frequency", repr(processing["base_frequency"])]
    words += ["--not-periodic"] if processing.get("periodic") is False else []
    for option in ("low_pass", "derivative_bandwidth"):
        words += [f"--{option.replace('_', '-')}", repr(processing[option])] if processing.get(option) else []
    words += ["--decimate", str(processing["decimate"])] if processing.get("decimate", 1) != 1 else []
    if processing.get("minimum_speed"):
        words += ["--minimum-speed", ",".join(repr(value) for value in processing["minimum_speed"])]
    if processing.get("anti_alias"):
        order, cutoff = processing["anti_alias"]
        words += ["--anti-alias", f"{order:g}:{cutoff:g}" if order else "none"]
    return words

"""The sections of a report: verdict, where models fail, candidates, error, parameters, torque, origin."""

from __future__ import annotations

import platform
import shlex
from collections.abc import Mapping, Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from robot_ident import __version__
from robot_ident.diagnosis.diagnosis import Diagnosis, Finding
from robot_ident.diagnosis.staircase import Level, Step
from robot_ident.effects.own import is_own
from robot_ident.figures.error_steps import staircase_figure, staircase_text
from robot_ident.figures.parameter_bars import candidates_figure, candidates_text, parameters_figure, parameters_text
from robot_ident.figures.residual_scatter import residual_over_figure, residual_over_text
from robot_ident.figures.residual_spectrum import LINES, residual_lines_figure, residual_lines_text, together
from robot_ident.figures.theme import POINTS
from robot_ident.figures.torque_over_time import torque_figure, torque_text
from robot_ident.model.model import Model
from robot_ident.recording.measurement import Source
from robot_ident.report.design_sections import excitations_section
from robot_ident.report.page import Plot, Section, Table, write_page
from robot_ident.report.wording import NOTHING, joined, percent, short, verdict, with_sigma
from robot_ident.residuals.beside import Beside, beside
from robot_ident.residuals.comparison import JointComparison
from robot_ident.residuals.residual_lines import ResidualLines, residual_lines
from robot_ident.robot.robot import Robot
from robot_ident.workflow.findings import Findings

_HEADER = ("effect", "", "explains", "p", "at joint", "before", "after", "validation before", "validation after")


def candidates_section(found: Findings) -> Section:
    """Return what the first and the last model lack: verdict, candidates, and what to do next."""
    models = []
    for place, diagnosis in sorted(found.diagnoses.items()):
        step, listed = found.steps[place], [*diagnosis.missing, *diagnosis.others]
        models.append(
            {
                "name": step.name,
                "verdict": diagnosis.in_words,
                "figure": Plot(candidates_figure(diagnosis), candidates_text(diagnosis)) if listed else None,
                "figures": Table(_HEADER, [_row(s, diagnosis) for s in listed], numeric=(2, 3, 5, 6, 7, 8)),
                "named": [_named(finding, step, found) for finding in diagnosis.missing],
                "remains": [
                    f"{joint} {value:.3g} {found.robot.torque_unit(found.robot.joint_index(joint))}"
                    for joint, value in diagnosis.remaining_rms.items()
                    if value > 0.0
                ],
                "unexplained": _unexplained(diagnosis),
            }
        )
    return Section("What is missing", "candidates.html.j2", {"models": models, "several": len(found.training) > 1})


def _named(finding: Finding, step: Step, found: Findings) -> dict[str, Any]:
    """Return a named effect with its size, its ties, the command that adds it, and the one that designs the motion
    which tells it from the first that it is tied with.
    """
    bags = [source.path for source in found.training]
    unseen = [word for source in found.validation for word in ("--validation", source.path)]
    add = ["robot_ident", "add", step.path, finding.label, "--bag", *bags, *unseen, "-o", "model_with_it.yaml"]
    effect, design = finding.effect, ["robot_ident", "design", "--model", step.path, "--tell", finding.label]
    return {
        "label": finding.label,
        "meaning": effect.meaning,
        "equation": effect.equation,
        "sizes": [p.in_words for p in finding.parameters],
        "tied": list(finding.tied_with),
        "experiment": finding.experiment or effect.experiment,
        "tell": shlex.join([*design, finding.tied_with[0], "-o", "tell.yaml"]) if finding.tied_with else "",
        "add": "" if effect.measuring else shlex.join(add),
    }


def _row(finding: Finding, diagnosis: Diagnosis) -> tuple[str, ...]:
    joint = finding.effect.place or max(finding.mse_before, key=lambda j: finding.mse_before[j] - finding.mse_after[j])
    unseen = [NOTHING, NOTHING]
    if finding.validation_before is not None and finding.validation_after is not None:
        unseen = [short(finding.validation_before[joint] ** 0.5), short(finding.validation_after[joint] ** 0.5)]
    return (
        finding.label,
        "missing" if finding in diagnosis.missing else "",
        percent(finding.explained),
        f"{finding.p_value:.1g}" if finding.p_value else "< 1e-300",
        joint,
        short(finding.mse_before[joint] ** 0.5),
        short(finding.mse_after[joint] ** 0.5),
        *unseen,
    )


def _unexplained(diagnosis: Diagnosis) -> dict[str, Any] | None:
    if diagnosis.unexplained is None:
        return None
    ranked = sorted(diagnosis.unexplained.depends_on.items(), key=lambda item: -item[1])
    shares = [f"{name.replace('_', ' ')} {percent(share)}" for name, share in ranked if share >= 0.005]
    return {"joint": diagnosis.unexplained.joint, "where": diagnosis.unexplained.where, "shares": shares}


_SENTENCES = 4  # regions named for a joint
_SHARE = 0.005  # of the excess from which on a variable is listed


def misfit_section(found: Findings) -> Section:
    """Return where the first and the last model fail: sentences and tables of the joints that each does not fit, and
    the figures.
    """
    besides = {step.name: [beside(step.model, one.measured) for one in found.training] for step in found.ends}
    lines = {
        name: [residual_lines(b, source.measured) for b, source in zip(every, found.training, strict=True)]
        for name, every in besides.items()
    }
    told = {
        "models": [_misfit(step, found.robot) for step in found.ends],
        "over": Plot(residual_over_figure(besides), residual_over_text(besides)),
        "lines": _line_plots(lines, found),
    }
    return Section("Where it fails", "misfit.html.j2", told)


def _misfit(step: Step, robot: Robot) -> dict[str, Any]:
    """Return the joints that a model does not fit: in words, and what their excess depends on."""
    failing = [joint for joint in step.comparison.joints if joint.explained_by]
    told = []
    for joint in failing:
        number = robot.joint_index(joint.name)
        beyond = "residual, noise included" if joint.noise_variance is None else "excess over the noise"
        excess = f"{short(joint.excess)} {robot.torque_unit(number)} rms {beyond}"
        words = [region.in_words(robot, number) for region in joint.worst[:_SENTENCES]]
        told.append({"name": joint.name, "excess": excess, "words": words, "reversal": _reversal(joint)})
    return {"name": step.name, "joints": told, "shares": _shares(failing)}


def _line_plots(lines: Mapping[str, list[ResidualLines]], found: Findings) -> list[Plot]:
    """Return the lines of all recordings together, or, where they don't share their frequencies, of each."""
    joint = {name: one for name, every in lines.items() if (one := together(every)) is not None}
    if len(joint) == len(lines):
        count = len(found.training)
        caption = f"Root mean square over {count} recordings. " if count > 1 else ""
        return [_line_plot(joint, count, found, caption)]
    return [
        _line_plot({name: every[k] for name, every in lines.items()}, 1, found, f"{source.path}. ")
        for k, source in enumerate(found.training)
    ]


def _line_plot(lines: Mapping[str, ResidualLines], count: int, found: Findings, caption: str) -> Plot:
    figure = residual_lines_figure(lines, found.robot, count)
    drawn = len(next(iter(lines.values())).frequency)
    if drawn > LINES:
        caption += f"Of {drawn} lines the extremes of {LINES // 2} stretches of frequency are drawn."
    return Plot(figure, residual_lines_text(lines, found.robot, count), caption.strip())


def _shares(joints: Sequence[JointComparison]) -> Table:
    """Return what a curve over each variable, and each band of frequency, holds of every joint's excess."""
    variables = dict.fromkeys(name for joint in joints for name in joint.explained_by)
    bands = dict.fromkeys((low, high) for joint in joints for low, high, _ in joint.by_frequency)
    held = {name.replace("_", " "): [joint.explained_by.get(name, 0.0) for joint in joints] for name in variables}
    for low, high in bands:
        parts = [{(a, b): part for a, b, part in joint.by_frequency} for joint in joints]
        held[f"{low:g} to {high:g} Hz"] = [one.get((low, high), 0.0) for one in parts]
    rows = [(name, *(percent(share) for share in of)) for name, of in held.items() if max(of) >= _SHARE]
    return Table(("share of the excess", *(joint.name for joint in joints)), rows, range(1, len(joints) + 1))


def _reversal(joint: JointComparison) -> str:
    if joint.odd is None or joint.even is None:
        return ""
    return (
        f"Under time reversal {percent(joint.odd)} of it is odd, as friction is, and {percent(joint.even)} even, as"
        " gravity, springs and inertia are."
    )


_UNSURE = 2.0  # sigmas of its value that a parameter must have to be told from zero


def parameters_section(found: Findings) -> Section:
    """Return every parameter of the last model, beside the first one's where there are two, those that are badly known,
    and how far they moved.
    """
    before, after = found.ends[0], found.ends[-1]
    was = {p.name: (value, std) for p, value, std in _rows(before.model)} if before is not after else {}
    unsure = [p.name for p, value, std in _rows(after.model) if std > 0.0 and abs(value) < _UNSURE * std]
    resting = {p.name for p, at_bound in zip(after.model.parameters, after.model.at_bound, strict=True) if at_bound}
    header = ["parameter", "value", "sigma", "unit", "sigma / value", "meaning"]
    rows = []
    for p, value, std in _rows(after.model):
        share = "at its bound" if p.name in resting else _share(value, std)
        row = [p.name, f"{value:.4g}", f"{std:.2g}" if std else NOTHING, p.unit, share, p.meaning]
        if was:
            row[1:1] = [with_sigma(*was[p.name]) if p.name in was else NOTHING]
        rows.append(row)
    if was:
        header[1:1] = [f"in {before.name}"]
    figure = Plot(parameters_figure(before.model, after.model), parameters_text(before.model, after.model))
    told = {
        "figures": Table(header, rows, numeric=(1, 2, 3, 5) if was else (1, 2, 4)),
        "model": after.name,
        "unsure": joined(unsure),
        "count": len(rows),
        "moved": figure if was else None,
        "before": before.name,
        "condition": f"{after.model.condition_number:.4g}",
        "determinant": f"{after.model.log10_det_covariance:.2f}",
        "estimator": after.model.estimator,
        "notes": list(after.model.notes),
    }
    return Section("Parameters", "parameters.html.j2", told)


def _rows(model: Model) -> list[tuple[Any, float, float]]:
    """Return parameters with value and standard deviation, 0 where there is none."""
    told = zip(model.parameters, model.values, model.std, model.at_bound, strict=True)
    return [(p, float(v), 0.0 if at_bound else float(s)) for p, v, s, at_bound in told]


def _share(value: float, std: float) -> str:
    if not std:
        return "given"
    share = 100.0 * std / abs(value) if value else float("inf")
    return f"{share:.1f} %" if share < 100.0 / _UNSURE else "badly known"


def staircase_section(found: Findings) -> Section:
    """Return excess over noise of every model, on fitted recordings and on the validation, with residual and noise."""
    steps, foreseen = found.steps, found.foreseen
    listed = [(step.name, step.added, step.training, step.validation) for step in steps]
    if foreseen is not None:
        listed.append(("predicted", foreseen.added, foreseen.training, foreseen.validation))
    rows = [
        (name, joined(added), joint, *_figures(training.get(joint)), *_figures(validation.get(joint)))
        for name, added, training, validation in listed
        for joint in found.robot.joints
    ]
    kinds = ("excess", "residual", "noise", "excess, validation", "residual", "noise")
    how = ""
    if found.validation:
        averaged = all(source.measured.base_frequency is not None for source in found.validation)
        how = "averaged periods, as on the fitted recordings" if averaged else "samples that move, low-passed"
        how = f"Validation: {how}."
    told = {
        "figure": Plot(staircase_figure(steps, foreseen), staircase_text(steps)),
        "figures": Table(("model", "adds", "joint", *kinds), rows, numeric=(3, 4, 5, 6, 7, 8)),
        "foreseen": None if foreseen is None else joined(foreseen.added),
        "how": how,
    }
    return Section("Error reduction", "staircase.html.j2", told)


def _figures(level: Level | None) -> tuple[str, str, str]:
    """Return excess, residual and noise in words; no excess where the noise is unknown."""
    if level is None:
        return NOTHING, NOTHING, NOTHING
    excess = NOTHING if level.noise is None else short(level.excess)
    return excess, short(level.rms), short(level.noise)


def torque_section(title: str, found: Findings, sources: Sequence[Source]) -> Section:
    """Return one period of every recording, as in the paper's Figs. 4 and 5."""
    plots = []
    for source in sources:
        besides = {step.name: beside(step.model, source.measured) for step in found.ends}
        caption = torque_caption(source.path, next(iter(besides.values())))
        plots.append(Plot(torque_figure(besides), f"{source.path}. {torque_text(besides)}", caption))
    missing = "None was given; --validation BAG2 adds one: only it shows whether an effect is real."
    return Section(title, "torque.html.j2", {"plots": plots, "missing": missing})


def torque_caption(path: str, one: Beside) -> str:
    """Return what was done to the recording before it is shown."""
    told = [path]
    if one.base_frequency is not None:
        told.append(f"mean of {one.periods} periods of {1.0 / one.base_frequency:.4g} s")
    if one.low_pass is not None:
        told.append(f"measured and predicted torque low-passed at {one.low_pass:g} Hz")
    if len(one.t) > POINTS:
        told.append(f"{len(one.t)} rows; of each curve the extremes of {POINTS // 2} stretches of time are drawn")
    if not one.used.all():
        told.append("residual only where rows count")
    return "; ".join(told) + "."


def verdict_section(found: Findings) -> Section:
    """Return the sentence that a reader who stops here takes away, how the last model fares at each joint, and what
    limits the judgement.
    """
    last, unseen = found.last, bool(found.last.validation)
    header = ["joint", "residual", "noise", "excess rms", "chi²/dof", "p", ""]
    rows = []
    for joint in last.comparison.joints:
        fit, noise = joint.misfit, joint.noise_variance
        floor, excess = (None, None) if noise is None else (noise**0.5, joint.excess)
        row = [joint.name, *(short(value) for value in (joint.residual_mse**0.5, floor, excess))]
        row += [NOTHING, NOTHING] if fit is None else [short(fit.statistic), f"{fit.p_value:.2g}"]
        row.append(joint.in_words)
        if unseen:
            level = last.validation[joint.name]
            row += [short(level.rms), short(level.noise)]
        rows.append(row)
    if unseen:
        header += ["on validation", "its noise"]
    told = {
        "verdict": verdict(found),
        "model": last.path,
        "unit": ", ".join(sorted({found.robot.torque_unit(k) for k in range(found.robot.n)})),
        "figures": Table(header, rows, numeric=(1, 2, 3, 4, 5, 7, 8)),
        "unseen": unseen,
        "notes": list(dict.fromkeys((*found.diagnosis.notes, *last.comparison.notes))),
    }
    return Section("Verdict", "verdict.html.j2", told)


_LIBRARIES = ("numpy", "scipy", "pin", "casadi", "plotly")


def origin_section(found: Findings) -> Section:
    """Return hashes, versions, options and commands."""
    sources = [(one, "fitted") for one in found.training] + [(one, "validation") for one in found.validation]
    header = ("recording", "as", "samples", "duration [s]", "compared rows")
    told = {
        "recordings": Table(header, [_recording(source, use) for source, use in sources], numeric=(2, 3)),
        "hashes": [f"{source.sha256}  {source.path}" for source, _ in sources],
        "notes": [f"{source.path}: {note}" for source, _ in sources for note in source.measured.notes],
        "models": [_model(step, {source.sha256 for source in found.training}) for step in found.steps],
        "versions": _versions(),
        "commands": [*(_made_by(step, found.effects_from) for step in found.steps), found.command],
    }
    return Section("Provenance", "origin.html.j2", told)


def _model(step: Step, here: set[str]) -> dict[str, Any]:
    """Return where a model comes from; here: the hashes of the recordings that it is held beside."""
    model, provenance = step.model, step.model.provenance
    seen = [one for one in provenance.get("recordings", []) if isinstance(one, Mapping)]
    if not seen:
        fitted = "its recordings are not noted"
    elif {one.get("sha256") for one in seen} == here:
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


def report_sections(found: Findings) -> list[Section]:
    """Return the sections of a report, in the order in which they are read."""
    return [
        verdict_section(found),
        staircase_section(found),
        torque_section("Measured and predicted", found, found.training),
        torque_section("On the validation motion", found, found.validation),
        misfit_section(found),
        candidates_section(found),
        parameters_section(found),
        excitations_section(found),
        origin_section(found),
    ]


def write_report(path: Path | str, found: Findings, *, force: bool = False) -> None:
    """Write the page, whole or not at all."""
    title, subtitle = report_title(found)
    write_page(path, title, report_sections(found), subtitle=subtitle, force=force)


def report_title(found: Findings) -> tuple[str, str]:
    """Return title and subtitle of a report."""
    models = ", ".join(step.path for step in found.steps)
    recordings = [source.path for source in (*found.training, *found.validation)]
    return f"{found.robot.name}: model vs. measurement", f"{models}, on {', '.join(recordings)}"

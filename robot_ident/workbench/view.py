"""What is looked at: a step of a session with all that the browser shows of it, read from disk once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from robot_ident.errors import InputError
from robot_ident.signals.motion import Array
from robot_ident.workbench.records import Lines, Rows, from_arrays
from robot_ident.workbench.session import Session, read_json

STEP, CANDIDATE = "step:", "with:"
"""What is laid over a residual: another step's model, or the step's own with a candidate."""


@lru_cache(maxsize=64)
def _arrays(path: str, _stamp: int) -> dict[str, Array]:
    with np.load(path, allow_pickle=False) as file:
        return {name: file[name] for name in file.files}


def _cached(path: Path) -> dict[str, Array]:
    """Return the arrays of a file, read again only where it changed."""
    return _arrays(str(path), path.stat().st_mtime_ns)


def most(before: Mapping[str, float], after: Mapping[str, float]) -> str:
    """Return the joint whose mean square falls most."""
    return max(before, key=lambda name: before[name] - after[name])


@dataclass(frozen=True)
class View:
    """A step of a session, as it is on disk."""

    session: Session
    number: int

    @classmethod
    def of(cls, session: Session) -> View | None:
        """Return the step that is looked at, None as long as there is none."""
        number = session.here
        return cls(session, number) if (session.step_folder(number) / "step.yaml").is_file() else None

    @cached_property
    def comparison(self) -> dict[str, Any]:
        """What `compare` says of it."""
        return self._read("comparison.json")

    @property
    def trouble(self) -> str | None:
        """Why the model can't be used at all, None where it can; steps of earlier versions don't say it."""
        found = self.comparison.get("trouble")
        return None if found is None else str(found)

    @property
    def unusable(self) -> list[str]:
        """On which recordings kept aside it is worse than none; steps of earlier versions don't say it."""
        return list(self.comparison.get("unusable", []))

    @cached_property
    def errors(self) -> dict[str, Any]:
        """Mean square errors on training and validation, and the noise of both."""
        return self._read("errors.json")

    @property
    def errors_so_far(self) -> list[dict[str, Any]]:
        """The errors of all steps from the first one to this."""
        return [View(self.session, number).errors for number in self.session.path(self.number)]

    @cached_property
    def diagnosis(self) -> dict[str, Any] | None:
        """What `diagnose` says of it, None as long as nobody asked."""
        return read_json(self.session.step_folder(self.number) / "diagnosis.json")

    @cached_property
    def previews(self) -> dict[str, dict[str, Any]]:
        """What each candidate that was looked at would do."""
        return self.session.previews(self.number)

    @cached_property
    def recordings(self) -> list[dict[str, Any]]:
        """The recordings, those of validation last."""
        return list((read_json(self.session.folder / "recordings.json") or {})["recordings"])

    @property
    def training(self) -> list[int]:
        """Places of the recordings that models are fitted to."""
        return [k for k, one in enumerate(self.recordings) if not one["validation"]]

    @cached_property
    def joints(self) -> list[str]:
        """Names of the joints."""
        return [str(joint["name"]) for joint in self.comparison["joints"]]

    @cached_property
    def rows(self) -> tuple[Rows, ...]:
        """The rows of every recording; measured torque as this step has it, where it found gains or payloads anew."""
        own = _cached(self.session.step_folder(self.number) / "series.npz")
        every = from_arrays(Rows, _cached(self.session.folder / "rows.npz"))
        return tuple(replace(one, measured=own.get(f"{k}.measured", one.measured)) for k, one in enumerate(every))

    @cached_property
    def loads(self) -> list[Array]:
        """The torque that the gears carry along every recording [N, n]."""
        return self._series("load")

    @cached_property
    def predicted(self) -> list[Array]:
        """The model's torque along every recording [N, n]."""
        return self._series("predicted")

    @cached_property
    def residual(self) -> list[Array]:
        """Measured less predicted along every recording [N, n]."""
        return [one.measured - torque for one, torque in zip(self.rows, self.predicted, strict=True)]

    @cached_property
    def lines(self) -> tuple[Lines, ...]:
        """Frequencies of the lines of every recording, and their noise."""
        return from_arrays(Lines, _cached(self.session.folder / "lines.npz"))

    @cached_property
    def residual_lines(self) -> list[Array]:
        """The residual of every recording by line [K, n] Nm rms."""
        return self._series("lines")

    @cached_property
    def worst(self) -> int:
        """The joint that most exceeds its noise, by statistic; by rms where the noise is unknown."""
        joints = self.comparison["joints"]
        if all(joint["fails"] is None for joint in joints):
            return max(range(len(joints)), key=lambda k: joints[k]["residual_mse"])
        return max(range(len(joints)), key=lambda k: joints[k]["lack_of_fit"]["statistic"] or 0.0)

    @cached_property
    def focus(self) -> int:
        """The joint that is shown as long as nobody chose one: where an effect was just added, the one whose error fell
        most, so that the fall is seen; else the worst.
        """
        parent = self.session.steps[self.number].parent
        if parent is None:
            return self.worst
        before, after = View(self.session, parent).errors["training"], self.errors["training"]
        return self.joints.index(most(before, after))

    @property
    def failing(self) -> list[str]:
        """Joints that the model does not fit."""
        return [str(joint["name"]) for joint in self.comparison["joints"] if joint["fails"]]

    @property
    def judged(self) -> bool:
        """Whether the recordings tell their noise, so that a model can be called adequate."""
        return any(joint["fails"] is not None for joint in self.comparison["joints"])

    def unit(self, joint: int) -> str:
        """Return the unit of a joint's torque."""
        return str(self.comparison["units"][joint])

    def overlay(self, key: str) -> Overlay:
        """Return what a key like `step:2` or `with:stribeck@joint_2` names; InputError where it isn't there."""
        kind, rest = key[:5], key[5:]
        if kind == STEP and rest.isdigit() and int(rest) in self.session.steps:
            other = View(self.session, int(rest))
            words = f"step {rest}" + (f" ({', '.join(self.session.added(int(rest)))})" if int(rest) else "")
            found = other.errors
            return Overlay(key, words, other.residual, other.residual_lines, found["training"], found["validation"])
        if kind == CANDIDATE and rest in self.previews:
            arrays = _cached(self.session.preview_file(self.number, rest, ".npz"))
            residual = [one.measured - arrays[f"{k}.predicted"] for k, one in enumerate(self.rows)]
            lines = [arrays[f"{k}.lines"] for k in range(len(self.rows))]
            data = self.previews[rest]
            return Overlay(key, f"with {rest}", residual, lines, data["after"], data["validation_after"])
        raise InputError(f"{key}: there is no such step or candidate")

    def overlays(self, keys: Sequence[str]) -> list[Overlay]:
        """Return what the keys name, leaving out what is not there (any more)."""
        found = []
        for key in keys:
            with suppress(InputError):
                found.append(self.overlay(key))
        return found

    def _series(self, name: str) -> list[Array]:
        arrays = _cached(self.session.step_folder(self.number) / "series.npz")
        return [arrays[f"{k}.{name}"] for k in range(len(self.rows))]

    def _read(self, name: str) -> dict[str, Any]:
        folder = self.session.step_folder(self.number)
        found = read_json(folder / name)
        if found is None:
            raise InputError(f"{folder}: {name} is missing; begin a new session")
        return found


@dataclass(frozen=True)
class Overlay:
    """Another residual laid over that of the step: along every recording [N, n] and by line [K, n], and its mean
    squares by joint.
    """

    key: str
    words: str
    residual: Sequence[Array]
    lines: Sequence[Array]
    training: Mapping[str, float]
    validation: Mapping[str, float] | None

"""What the paper leaves as future work: the missing effects are named and added, and the figures are drawn again."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from robot_ident.bags import write_recording
from robot_ident.diagnosis.diagnosis import Diagnosis
from robot_ident.diagnosis.staircase import Level, Step, staircase
from robot_ident.effects import make_effect
from robot_ident.estimation.identify import estimate
from robot_ident.model.structure import Structure
from robot_ident.paper.friction import PERIODS, RealRobot
from robot_ident.paper.robots import without_known_effects
from robot_ident.recording.measurement import Source
from robot_ident.recording.process import process
from robot_ident.recording.recording import Recording
from robot_ident.trajectories.point_to_point import PointToPoint
from robot_ident.workflow.inputs import Inputs
from robot_ident.workflow.steps import add_until_adequate, find_missing, steps_of

SEEN = "gravity_spring@joint_2"
"""What whoever stands before the robot knows of it without a measurement."""


@dataclass(frozen=True)
class Missing:
    """Section VI on the simulated robot: what it has that the 21 parameters lack, what was named, and each step.

    truth: the effects of the simulated robot beyond the 21 parameters, as `name@joint`. said: every diagnosis.
    chosen: the set of effects that was taken where the first one could not decide between sets. known: the model of
    section V with spring and torque offsets, 25 parameters, on the same recordings.
    """

    truth: tuple[str, ...]
    said: tuple[Diagnosis, ...]
    chosen: tuple[str, ...]
    steps: tuple[Step, ...]
    known: Step
    recordings: tuple[Recording, ...]
    validation_recording: Recording

    @property
    def named(self) -> tuple[str, ...]:
        """All effects that were added."""
        return self.steps[-1].model.structure.labels[self.steps[0].model.structure.given :]

    @property
    def right(self) -> tuple[str, ...]:
        """Effects of the truth that were added."""
        return tuple(label for label in self.truth if label in self.named)

    @property
    def wrong(self) -> tuple[str, ...]:
        """Effects that were added although the robot doesn't have them."""
        return tuple(label for label in self.named if label not in self.truth)

    def to_dict(self) -> dict[str, Any]:
        """Return all figures."""
        return {
            "truth": list(self.truth),
            "named": list(self.named),
            "chosen": list(self.chosen),
            "tied_sets": [list(labels) for said in self.said for labels in said.to_dict()["tied_sets"]],
            "right": list(self.right),
            "wrong": list(self.wrong),
            "verdict": self.said[-1].verdict,
            "steps": [_step_dict(step) for step in self.steps],
            "with_spring_and_offsets": _step_dict(self.known),
        }


def _step_dict(step: Step) -> dict[str, Any]:
    return {
        "added": list(step.added),
        "residual_mse": [level.mse for level in step.training.values()],
        "noise_variance": [level.noise_variance for level in step.training.values()],
        "validation_mse": [level.mse for level in step.validation.values()],
    }


def missing(real: RealRobot, motion: PointToPoint) -> Missing:
    """Return what becomes of the paper's 21 parameters on the robot of section V: spring, torque offsets and friction
    are hidden from the model, both trajectories are fitted, the 20 points validate. Where the first diagnosis can't
    decide between sets, the one with the spring is taken, which whoever stands before the robot sees.
    """
    bare = without_known_effects(real.robot)
    structure = Structure.build(bare)
    fitted = [real.measured(criterion) for criterion in real.motions]
    unseen = real.validation(motion)
    with tempfile.TemporaryDirectory() as folder:
        paths = []
        for number, recording in enumerate((*fitted, unseen)):
            paths.append(Path(folder) / f"{number}.npz")
            write_recording(paths[-1], recording)
        measured = tuple(process(recording, bare) for recording in fitted)
        aside = (process(unseen, bare),)
        first = estimate(measured, structure)
        inputs = Inputs((first,), ("model.yaml",), tuple(map(str, paths[:-1])), measured, aside, (str(paths[-1]),))
        said = find_missing(first, measured, aside)
        chosen = _chosen(said)
        named = {finding.label: finding.effect for finding in said.missing if not finding.effect.measuring}
        effects = [named[label] if label in named else make_effect(label, bare) for label in chosen or named]
        steps = steps_of(inputs, effects)
        longer = inputs.with_model(steps[-1].model)
        added = add_until_adequate(find_missing(longer.models[0], longer.measurements, longer.validation), longer)
    models = [(f"model {number}", one.model) for number, one in enumerate((*steps, *added.steps[1:]), 1)]
    sources = [Source(one.source, "", one, two) for one, two in zip(fitted, measured, strict=True)]
    hidden = (*real.robot.known_effects, *(text.partition(":")[0] for text in real.hidden))
    whole = estimate([process(recording, real.robot) for recording in fitted], Structure.build(real.robot))
    aside_source = [Source(unseen.source, "", unseen, aside[0])]
    way = [
        replace(step, validation={joint: _averaged(level) for joint, level in step.validation.items()})
        for some in ([("25 parameters", whole)], models)
        for step in staircase(some, sources, aside_source)
    ]
    return Missing(hidden, (said, *added.said), chosen, tuple(way[1:]), way[0], tuple(fitted), unseen)


def _averaged(level: Level) -> Level:
    """Return a level whose noise is that of the mean of 16 runs."""
    return Level(level.mse, None if level.noise_variance is None else level.noise_variance / PERIODS)


def _chosen(said: Diagnosis) -> tuple[str, ...]:
    """Return the set of effects, of those between which the recordings can't decide, that holds the spring."""
    sets: Sequence[Sequence[str]] = said.to_dict()["tied_sets"]
    return next((tuple(labels) for labels in sets if SEEN in labels), ())

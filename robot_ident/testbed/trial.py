"""Hides effects in the simulated robot and diagnoses them: how often is the truth named?

Each case draws what is hidden, simulates its recordings with the plant's own physics, identifies, diagnoses, adds what
was found, and looks at a motion that no fit has seen.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import partial
from typing import Any, Self

import numpy as np
from pydantic import TypeAdapter

from robot_ident.diagnosis.diagnose import diagnose
from robot_ident.diagnosis.diagnosis import Diagnosis
from robot_ident.errors import InputError
from robot_ident.estimation.identify import estimate
from robot_ident.model.model import Model
from robot_ident.model.structure import Structure
from robot_ident.recording.effort import as_reported, joint_torque
from robot_ident.recording.measurement import Measurement
from robot_ident.recording.periodic import at_rest
from robot_ident.recording.process import process
from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Array, Mask, Motion
from robot_ident.testbed.calibrate import torque_scale
from robot_ident.testbed.faulty_recordings import draw_fault, recordings_with
from robot_ident.testbed.scenario import draw_scenario
from robot_ident.testbed.simulation import Play
from robot_ident.trajectories.fourier_series import FourierSeries

_PERIODS = 2  # without noise; one would do, did no robot warm up from one to the next


@dataclass(frozen=True)
class TrueMotion:
    """A motion that the encoders show without noise or steps, and the torque of the drives along it.

    Steps alone, without noise that dithers them, hide more of a fast motion's acceleration than the paper's noise does:
    M(q) times that would count as a model's error, and does not belong to it.

    motion: mean of its periods; torque [N, n] as reported, brought to the joints; moving [N]: rows in which no joint
    rests, where stiction would leave the torque undetermined.
    """

    motion: Motion
    torque: Array
    moving: Mask

    @classmethod
    def of(cls, play: Play) -> TrueMotion:
        """Return the mean of the first periods of a robot's steady answer."""
        made, robot = play.readings(_PERIODS), play.robot

        def mean(x: Array) -> Array:
            return np.asarray(x.reshape(_PERIODS, -1, robot.n).mean(axis=0))

        dt = 1.0 / play.sample_rate
        period = len(made.shown_q) // _PERIODS * dt
        q, dq, ddq = (mean(x) for x in (made.shown_q, made.shown_dq, made.shown_ddq))
        motion = Motion(q, dq, ddq, dt=dt, periodic=True, began=tuple(k * period for k in range(_PERIODS)))
        reported = as_reported(made.recorded, made.shown_q, robot)
        torque = mean(joint_torque(reported, made.shown_q, robot))
        return cls(motion, torque, np.asarray(~at_rest(motion, robot).any(axis=1)))

    def errors(self, model: Model) -> Array:
        """Return a model's mean square error [n] (Nm)^2."""
        return np.asarray(np.mean((self.torque - model.predict(self.motion))[self.moving] ** 2, axis=0))


MEASUREMENT = "measurement"
"""The kind of a case in which the measuring is at fault and the arm is as modelled."""


@dataclass(frozen=True)
class Setting:
    """What all cases of a trial share.

    training: motions that are identified and diagnosed; unseen: one that no fit sees. periods of each; noise: factor on
    the variances of the robot's noise.
    """

    robot: Robot
    training: tuple[FourierSeries, ...]
    unseen: FourierSeries
    periods: int = 16
    noise: float = 1.0


@dataclass(frozen=True)
class Case:
    """One case: its seed, and the kind of scenario (None: drawn as well)."""

    seed: int
    kind: str | None = None


@dataclass(frozen=True)
class AsData:
    """What one case gave, kept in the file of finished cases."""

    def to_dict(self) -> dict[str, Any]:
        """Return it as data."""
        return asdict(self)

    @classmethod
    def of_dict(cls, data: Mapping[str, Any]) -> Self:
        """Return it from its data; pydantic's ValidationError where these are none."""
        return TypeAdapter(cls).validate_python(dict(data))


@dataclass(frozen=True)
class Outcome(AsData):
    """What was hidden, and what was said of it.

    hidden: with their values; truth, background: `name@joint` of what was to be found and of what else there was.
    visible [Nm rms]: what a model without it leaves, by joint. named: members of `missing`; tied: their tie groups.
    error_before, error_after: mean square error along an unseen motion as it truly was, by joint [(Nm)^2], before and
    after what was named was added; None where nothing was. scale [Nm]: what the joints' errors are compared in, their
    noise. seconds: processor time of the diagnosis. trouble: the message where `add` was refused. tied_sets: the sets
    that could not be told apart; probability: of every name told, where there is one.
    """

    seed: int
    kind: str
    hidden: tuple[str, ...]
    truth: tuple[str, ...]
    background: tuple[str, ...]
    visible: Mapping[str, float]
    verdict: str
    named: tuple[str, ...]
    tied: tuple[tuple[str, ...], ...]
    explained: tuple[float, ...]
    others: tuple[str, ...]
    remaining_rms: Mapping[str, float]
    error_before: Mapping[str, float] | None
    error_after: Mapping[str, float] | None
    scale: Mapping[str, float]
    seconds: float
    tied_sets: tuple[tuple[str, ...], ...] = ()
    probability: Mapping[str, float] = field(default_factory=dict)
    trouble: str = ""

    @classmethod
    def of(
        cls,
        found: Diagnosis,
        robot: Robot,
        *,
        visible: Sequence[float] | Array,
        errors: tuple[Array, Array] | None = None,
        background: tuple[str, ...] = (),
        **case: Any,
    ) -> Self:
        """Return what a diagnosis said of one case, of any simulator.

        visible [n] Nm rms; errors: mean squares [n] (Nm)^2 before and after; case: seed, kind, hidden, truth, seconds,
        and trouble where there was any.
        """

        def by_joint(values: Sequence[float] | Array) -> dict[str, float]:
            return {joint: float(value) for joint, value in zip(robot.joints, values, strict=True)}

        before, after = (None, None) if errors is None else map(by_joint, errors)
        return cls(
            **case,
            background=background,
            visible=by_joint(visible),
            verdict=found.verdict,
            named=tuple(s.label for s in found.missing),
            tied=tuple(s.tied_with for s in found.missing),
            explained=tuple(s.explained for s in found.missing),
            others=tuple(s.label for s in found.others),
            remaining_rms=dict(found.remaining_rms),
            error_before=before,
            error_after=after,
            scale=by_joint(torque_scale(robot)),
            tied_sets=found.tied_sets,
            probability={s.label: s.probability for s in (*found.missing, *found.others) if s.probability is not None},
        )

    @property
    def removed(self) -> float | None:
        """Share of the error on the unseen motion that adding what was named has removed; None where nothing was.

        1 - sum_j (e_j after / s_j)^2 / sum_j (e_j before / s_j)^2, each joint in units of its noise s_j: a wrist counts
        as a shoulder does, a force as a torque.
        """
        if self.error_before is None or self.error_after is None:
            return None
        before, after = (
            sum(error[joint] / self.scale[joint] ** 2 for joint in self.scale)
            for error in (self.error_before, self.error_after)
        )
        return 1.0 - after / max(before, 1e-300)


def run_case(case: Case, setting: Setting) -> Outcome:
    """Hide, simulate, identify, diagnose, add.

    Where measuring is at fault nothing is added, since the remedy is not in the model.
    """
    robot, structure, unseen = setting.robot, Structure.build(setting.robot), None
    hidden: dict[str, Any]
    if case.kind == MEASUREMENT:
        fault = draw_fault(case.seed, robot, len(setting.training))
        spoilt = partial(recordings_with, fault, robot, setting.training, seed=case.seed)
        recordings = spoilt(periods=setting.periods, noise=setting.noise)
        # What a model leaves that is fitted to the same without noise.
        quiet = [process(recording, robot) for recording in spoilt(periods=_PERIODS, noise=0.0)]
        fits = estimate(quiet, structure, estimator="ls").residual.values()
        hidden = {"kind": MEASUREMENT, "hidden": (fault.text(robot),), "truth": (fault.label(robot),), "background": ()}
        visible: Sequence[float] = [fit.rms for fit in fits]
    else:
        kinds = () if case.kind is None else (case.kind,)
        scenario = draw_scenario(case.seed, robot, kinds=kinds, references=setting.training)
        *plays, last = scenario.plays(robot, [*setting.training, setting.unseen])
        seeds = np.random.SeedSequence([case.seed, 1]).generate_state(len(plays))
        recordings = [
            play.record(setting.periods, noise=setting.noise, seed=int(seed))
            for play, seed in zip(plays, seeds, strict=True)
        ]
        hidden = {"kind": scenario.kind, "hidden": scenario.all_effects, "truth": scenario.labels}
        hidden["background"] = tuple(effect.partition(":")[0] for effect in scenario.background)
        visible, unseen = scenario.visible_rms, TrueMotion.of(last)
    measurements = [process(recording, robot) for recording in recordings]
    started = time.process_time()
    found = diagnose(measurements, structure)
    seconds = time.process_time() - started
    errors, trouble = (None, "") if unseen is None else _errors(measurements, structure, found, unseen)

    return Outcome.of(
        found, robot, seed=case.seed, **hidden, visible=visible, seconds=seconds, errors=errors, trouble=trouble
    )


def _errors(
    measurements: list[Measurement], structure: Structure, found: Diagnosis, unseen: TrueMotion
) -> tuple[tuple[Array, Array] | None, str]:
    """Return the mean square errors [n] (Nm)^2 on the unseen motion before and after what was named is added, or why
    it couldn't be.
    """
    named = [finding.effect for finding in found.missing if not finding.effect.measuring]
    if not named:
        return None, ""
    try:
        longer = Structure.build(structure.robot, named)
        before, after = (unseen.errors(estimate(measurements, s)) for s in (structure, longer))
    except InputError as error:
        return None, str(error)
    return (before, after), ""

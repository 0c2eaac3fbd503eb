"""A model's torque and its effects' shares along the samples of a recording, for viewers that play it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from robot_ident.model.model import Model
from robot_ident.recording.averaging import average
from robot_ident.recording.clock import read_clock
from robot_ident.recording.effort import at_the_joints
from robot_ident.recording.measurement import Measurement
from robot_ident.recording.recording import Recording
from robot_ident.signals.motion import Array


@dataclass(frozen=True)
class Along:
    """Rows of a recording, as it was read, with the model's torque [N, n] Nm and each effect's share of it.

    measured: torque as recorded, not averaged. shares: by the name of the effect, rigid bodies first.
    """

    rows: Recording
    predicted: Array
    shares: Mapping[str, Array]

    @property
    def measured(self) -> Array:
        """Torque as recorded [N, n] Nm."""
        return self.rows.tau

    @property
    def residual(self) -> Array:
        """Measured less predicted [N, n] Nm."""
        return self.rows.tau - self.predicted


def along(model: Model, recording: Recording, measured: Measurement) -> Along:
    """Return the model along the samples of a recording of which `measured` was made.

    Periodic: the steady periods, or the cycles, the model being evaluated on their mean motion, which has little noise;
    what comes before, between and after them is left out. Otherwise all samples.
    """
    recording = at_the_joints(recording.with_joints(model.robot.joints), model.robot)
    clock = read_clock(recording)
    by_effect = shares(model, measured)
    if measured.base_frequency is None:
        phase, period = clock.t - clock.t[0], None
        rows = np.ones(recording.samples, dtype=bool)
    elif measured.cycles is not None:
        phase, period = measured.cycles.phase(clock.t), measured.cycles.length
        rows = np.isfinite(phase)
        phase = phase[rows]
    else:
        period = 1.0 / measured.base_frequency
        steady, _ = average(recording, clock, period / clock.dt)
        begin = steady.last - round(steady.periods * steady.period) + 1
        elapsed = clock.t - clock.t[0] - begin * clock.dt
        rows = (elapsed > -0.5 * clock.dt) & (elapsed < steady.periods * period - 0.5 * clock.dt)
        phase = elapsed[rows]
    grid = np.arange(measured.motion.samples) * measured.dt
    there = {
        name: np.column_stack([np.interp(phase, grid, column, period=period) for column in share.T])
        for name, share in by_effect.items()
    }
    return Along(recording[rows], np.sum(list(there.values()), axis=0), there)


def shares(model: Model, measured: Measurement) -> dict[str, Array]:
    """Return each effect's share [N, n] Nm of the model's torque along a measurement's motion, by the effect's name."""
    columns = model.structure.columns(measured.motion, model.linear)
    out: dict[str, Array] = {}
    for place, parameter in enumerate(model.structure.parameters):
        share = columns[:, :, place] * model.linear[place]
        out[parameter.effect] = out[parameter.effect] + share if parameter.effect in out else share
    if measured.conditions.payload is not None:
        out["payload"] = measured.conditions.payload.torque(model.robot, measured.motion)
    return out

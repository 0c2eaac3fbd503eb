"""A simulated robot's motion as it truly is, on which models are judged."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from robot_ident.model.model import Model
from robot_ident.recording.effort import as_reported, joint_torque
from robot_ident.recording.periodic import at_rest
from robot_ident.signals.motion import Array, Mask, Motion
from robot_ident.simulation.periodic import Play

_PERIODS = 2  # one would do, did no robot warm up from one to the next


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

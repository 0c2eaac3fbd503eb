"""A model's torque beside a measurement's, row by row as the two are compared: what is looked at."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from robot_ident.model.model import Model
from robot_ident.recording.measurement import Measurement
from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Array, Mask


@dataclass(frozen=True)
class Beside:
    """Measured and predicted torque of R rows and n joints, low-passed and decimated as they are compared.

    t [R] s: from the start of the recording, or of its mean period where `periods` were averaged into one. q, dq, ddq
    [R, n]: the motion. load [R, n] Nm: what the gears carry. measured, predicted [R, n] Nm. used [R, n]: rows that
    count. sigma [n] Nm: standard deviation of the noise of a measured row, nan where unknown. independent: share of the
    rows that carry noise of their own. base_frequency: Hz, None where the motion does not repeat. low_pass: Hz, None
    where nothing is filtered.
    """

    source: str
    robot: Robot
    t: Array
    q: Array
    dq: Array
    ddq: Array
    load: Array
    measured: Array
    predicted: Array
    used: Mask
    sigma: Array
    independent: float
    periods: int
    base_frequency: float | None
    low_pass: float | None

    @property
    def residual(self) -> Array:
        """Measured less predicted [R, n] Nm."""
        return self.measured - self.predicted

    def mean_square(self) -> Array:
        """Return the mean square [n] (Nm)^2 of the residual over the rows that count."""
        total = np.sum(np.where(self.used, self.residual**2, 0.0), axis=0)
        return np.asarray(total / np.maximum(self.used.sum(axis=0), 1))


def beside(model: Model, measured: Measurement) -> Beside:
    """Return a model, as it stands, beside one measurement of its robot."""
    rows, motion, structure = measured.rows, measured.motion, model.structure
    rigid = structure.rigid_columns(motion)
    predicted = structure.columns(motion, model.linear, rigid) @ model.linear
    own = (structure.columns_of(effect, motion) for effect in structure.effects if not effect.uses_torque)
    plain = [structure.reported(rigid), *own]
    load, _, _ = structure.load_total_dry(plain, model.linear)
    return Beside(
        source=measured.source,
        robot=model.robot,
        t=np.asarray(np.arange(motion.samples)[rows] * measured.dt, dtype=float),
        q=motion.q[rows],
        dq=motion.dq[rows],
        ddq=motion.ddq[rows],
        load=np.asarray(load)[rows],
        measured=measured.passed(measured.torque),
        predicted=measured.passed(predicted),
        used=measured.used[rows],
        sigma=np.sqrt(noise_variance(model, measured)),
        independent=measured.independent,
        periods=measured.periods,
        base_frequency=measured.base_frequency,
        low_pass=None if measured.low_pass is None else measured.low_pass.cutoff,
    )


def noise_variance(model: Model, measured: Measurement) -> Array:
    """Return the variance [n] (Nm)^2 of the noise of a measured row: told by its periods, else by the model, else
    nan.
    """
    own = measured.averaged_variance
    if np.all(np.isfinite(own)) and np.all(own > 0):
        return own
    listed = np.array([np.nan if v is None else v for v in model.noise.torque_variance], dtype=float)
    share = measured.low_pass.independent if measured.low_pass else 1.0
    return np.asarray(np.where(listed > 0, listed * share, np.nan))

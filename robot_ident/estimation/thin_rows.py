"""A recording as one pass on a grid no finer than its band needs: what candidates of processing are compared on."""

from __future__ import annotations

from dataclasses import dataclass, replace

from robot_ident.model.structure import Structure
from robot_ident.recording.averaging import FINE
from robot_ident.recording.clock import read_clock
from robot_ident.recording.measurement import Measurement, Processing
from robot_ident.recording.process import process
from robot_ident.recording.recording import Recording
from robot_ident.robot.robot import Robot
from robot_ident.signals.filters import ZeroPhaseLowPass
from robot_ident.signals.motion import Array, Mask, Motion

_SLOWEST = 100.0  # Hz


@dataclass(frozen=True)
class ThinRows:
    """Every `step`-th sample of a recording that was taken as one pass, its positions differentiated to `wide` [Hz]."""

    measured: Measurement
    step: int
    wide: float

    @property
    def sample_dt(self) -> float:
        """Time between samples [s]."""
        return self.measured.dt

    @property
    def dt(self) -> float:
        """Time between rows [s]."""
        return self.measured.dt * self.step

    @property
    def used(self) -> Mask:
        """Rows [N, n] that count."""
        return self.measured.used[:: self.step]

    def columns(self, structure: Structure) -> Array:
        """Return the columns [N, n, P] along the motion, before any low pass."""
        return structure.columns(self.motion)

    @property
    def motion(self) -> Motion:
        """The motion [N, n] of the rows."""
        whole, step = self.measured.motion, self.step
        return Motion(whole.q[::step], whole.dq[::step], whole.ddq[::step], dt=self.dt, gravity=whole.gravity)

    def torque(self, cutoff: float | None) -> Array:
        """Return the torque [N, n], low-passed at `cutoff` [Hz]; None: at what the rows can hold."""
        held = 0.45 / self.dt if cutoff is None else cutoff
        if cutoff is None and self.step == 1:
            return self.measured.torque
        low_pass = ZeroPhaseLowPass(held, self.measured.dt, len(self.measured.torque))
        return low_pass.apply(self.measured.torque)[:: self.step]

    def passed(self, x: Array, cutoff: float) -> Array:
        """Return x [N, ...] low-passed at `cutoff` [Hz]."""
        return ZeroPhaseLowPass(cutoff, self.dt, len(x)).apply(x)


def thin_rows(recording: Recording, robot: Robot, processing: Processing, band: float, *, wider: float) -> ThinRows:
    """Return a recording as one pass, low-passed at `band` [Hz], its positions differentiated to `wider` times that."""
    nyquist = 0.5 / read_clock(recording.with_joints(robot.joints)).dt
    low_pass, wide = min(band, 0.8 * nyquist), min(wider * band, 0.8 * nyquist)
    asked = replace(processing, periodic=False, base_frequency=None, decimate=1)
    measured = process(recording, robot, replace(asked, low_pass=low_pass, derivative_bandwidth=wide))
    return ThinRows(measured, max(1, int(1.0 / (measured.dt * max(_SLOWEST, FINE * low_pass)))), wide)

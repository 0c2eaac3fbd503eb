"""A processed recording: motion with its derivatives and torque on an even grid, its noise, which rows count, what
beside its stamps tells how fast its time runs; the arm's own share of the torque, less a known payload.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from robot_ident.model.base_parameters import reduce_to_base
from robot_ident.recording.clock import Stamps
from robot_ident.recording.conditions import Conditions, KnownPayload
from robot_ident.recording.cycles import Cycles
from robot_ident.recording.noise_spectrum import NoiseSpectrum, OffClock
from robot_ident.recording.recording import Recording
from robot_ident.robot.robot import Robot
from robot_ident.signals.filters import LowPass, PeriodicLowPass, SoftPeriodicLowPass
from robot_ident.signals.motion import Array, Mask, Motion

TimeScale = Literal["", "period", "received", "apart"]
"""`period`: that of the motion is declared; `received`: the times at which messages came say the same, `apart`: they
say something else; empty: nothing tells.
"""

DEFAULT_LOW_PASS = 10.0  # Hz, the paper's choice for validation


@dataclass(frozen=True)
class Processing:
    """How recordings are processed; kept in the model so that later ones are treated alike.

    base_frequency: Hz, None = found from the data. periodic: None = decided by the data. low_pass: Hz, torque and every
    column; None = none on periodic recordings, 10 Hz on others. derivative_bandwidth: Hz of the differentiation of non-
    periodic positions to accelerations; None = 4 low_pass. velocity_bandwidth: Hz of the differentiation to velocities;
    None = where the time of a reversal is known best, each never below derivative_bandwidth. decimate: every how many
    rows one is kept after the low pass. minimum_speed: rad/s below which samples are left out; None = the robot's own.
    anti_alias: (order, Hz) of the filter in the torque channel, order 0: there is none; None = what the robot declares.
    band: Hz of the low pass that brings the model's torque nearest to the record, where it was found; predictions take
    it, and validations. band_derivative: Hz of differentiation that predictions take at most.
    """

    base_frequency: float | None = None
    periodic: bool | None = None
    low_pass: float | None = None
    derivative_bandwidth: float | None = None
    decimate: int = 1
    minimum_speed: tuple[float, ...] | None = None
    anti_alias: tuple[float, float] | None = None
    band: float | None = None
    band_derivative: float | None = None
    velocity_bandwidth: float | None = None


@dataclass(frozen=True)
class Measurement:
    """One recording ready for estimation.

    dt: time between rows [s]. motion: q, dq, ddq [N, n]. torque [N, n] Nm, unfiltered. used [N, n]: rows that count.
    torque_variance, position_variance [n]: noise of one raw sample, nan where unknown. periods: M averaged, 1 where
    none, of samples_per_period samples; averages: how many samples' noise is averaged in a row of `torque`.
    variance_dof: degrees of freedom of torque_variance. base_frequency: Hz, None where not periodic. low_pass: what
    torque and columns pass before they are compared, or None. decimate: rows kept after it, one in so many.
    period_torque [M, N, n]: the periods one by one (gaps nan), or None. standstill [N, n]: rows at rest.

    noise: spectrum of the torque's noise, None where no periods tell it. quantisation [n] (Nm)^2: variance that
    rounding leaves in a row of `torque` and no averaging removes. position_lines [K + 1, n]: the Fourier lines of
    the positions that stand above the noise, line_share [K + 1, n]: the share of each line that `motion` holds, of
    fainter ones too; averaged_position_variance [n] rad^2: of a row of the averaged position, white. left_out: numbers
    of periods unlike the others, from 1. cycles: where periods are cycles with pauses between them, None elsewhere.
    stamps: what the stamps are worth, and sample_rate [Hz] of the recording. off_clock: how far the samples' instants
    scatter about their stamps, None where no periods tell. conditions: what the recording's sidecar states; start_ns:
    absolute stamp of its first sample, 0 where not known. clipped: of which joints' efforts something was cut off.
    unknown [N, n]: rows whose torque isn't known, since something was cut off or frozen in it, None where it is of all.
    time_scale: what, beside the stamps, tells how fast they run. position_step [n]: of which all recorded positions are
    multiples, 0 where there is none. acceleration_error [n] (rad/s^2)^2: variance that the differentiation of one
    pass errs by as it is compared, None elsewhere.
    """

    source: str
    joints: tuple[str, ...]
    dt: float
    motion: Motion
    torque: Array
    used: Mask
    standstill: Mask
    torque_variance: Array
    position_variance: Array
    periods: int = 1
    samples_per_period: int = 0
    averages: float = 1.0
    variance_dof: float = 0.0
    base_frequency: float | None = None
    low_pass: LowPass | None = None
    decimate: int = 1
    period_torque: Array | None = None
    notes: tuple[str, ...] = ()
    noise: NoiseSpectrum | None = None
    quantisation: Array | None = None
    position_lines: Mask | None = None
    line_share: Array | None = None
    averaged_position_variance: Array | None = None
    left_out: tuple[int, ...] = ()
    off_clock: OffClock | None = None
    cycles: Cycles | None = None
    stamps: Stamps | None = None
    sample_rate: float = 0.0
    conditions: Conditions = Conditions()
    start_ns: int = 0
    clipped: tuple[str, ...] = ()
    unknown: Mask | None = None
    time_scale: TimeScale = ""
    position_step: Array | None = None
    acceleration_error: Array | None = None

    def facts(self) -> dict[str, Any]:
        """Return how the recording was taken: its rate and clock, what of it repeats, and by joint the lowest and
        highest position and the top speed.
        """
        top = np.abs(self.motion.dq).max(axis=0)
        kind = "one_pass" if self.base_frequency is None else "periods" if self.cycles is None else "cycles"
        return {
            "source": self.source,
            "sample_rate": self.sample_rate,
            "clock": None if self.stamps is None else self.stamps.to_dict(),
            "taken_as": kind,
            "period": None if self.base_frequency is None else 1.0 / self.base_frequency,
            "repeats": self.periods,
            "time_scale": self.time_scale or None,
            "reach": {
                name: [float(self.motion.q[:, k].min()), float(self.motion.q[:, k].max()), float(top[k])]
                for k, name in enumerate(self.joints)
            },
        }

    @property
    def fastest(self) -> float:
        """Frequency [Hz] up to which the rows show anything: half their rate, or the corner of the low pass."""
        highest = 0.5 / (self.dt * self.decimate)
        return highest if self.low_pass is None else min(highest, self.low_pass.cutoff)

    @property
    def rows(self) -> slice:
        """The rows kept by decimation."""
        return slice(None, None, self.decimate)

    @property
    def averaged_variance(self) -> Array:
        """Noise variance [n] of the compared torque: averaged over the periods, after the low pass."""
        share = self.low_pass.independent if self.low_pass else 1.0
        rounding = np.zeros(len(self.joints)) if self.quantisation is None else self.quantisation
        if self.noise is not None and isinstance(self.low_pass, PeriodicLowPass | SoftPeriodicLowPass):
            return self.noise.passed_variance(self.low_pass.gain) / self.averages + rounding * share
        return (self.torque_variance / self.averages + rounding) * share

    @property
    def independent(self) -> float:
        """Share of the rows, after decimation, that carry independent noise."""
        share = self.low_pass.independent if self.low_pass else 1.0
        return min(1.0, share * self.decimate)

    def passed(self, x: Array) -> Array:
        """Return x [N, ...] as it is compared: low-passed and decimated."""
        y = self.low_pass.apply(x) if self.low_pass else x
        return y[self.rows]


@dataclass(frozen=True)
class Source:
    """A recording by its path and sha256, as read, and as it was processed for a model."""

    path: str
    sha256: str
    recording: Recording
    measured: Measurement


_SAME = 0.01  # by which the pace of two clocks may differ: 2 % of inertia


def time_scale(recording: Recording, base_frequency: float | None) -> TimeScale:
    """Return what tells: `period` where the motion's is declared, `received` where messages were received at the pace
    of their stamps, `apart` where they came at another pace; empty where nothing does.

    base_frequency [Hz]: as the user declares it. The recording was found to have it.
    """
    if base_frequency is not None:
        return "period"
    if recording.pace is None:
        return ""
    return "received" if abs(recording.pace - 1.0) < _SAME else "apart"


def time_scale_notes(measurements: Sequence[Measurement]) -> list[str]:
    """Return a line that names the recordings whose time scale nothing verifies, and one those whose messages came at
    another pace than their stamps.
    """
    untimed, apart = ([m.source for m in measurements if m.time_scale == kind] for kind in ("", "apart"))
    notes = []
    if untimed:
        notes.append(
            f"time scale not verified ({', '.join(untimed)}): only the stamps give it, and an error of 1 % changes"
            " inertias by 2 %; give --trajectory EXCITATION once per recording, or a bag with receive times"
        )
    if apart:
        notes.append(
            f"time scale contradicted ({', '.join(apart)}): messages came at another pace than their stamps; right for"
            " a simulated robot, on a real one the stamps' clock runs wrong, and inertia goes with the square of it"
        )
    return notes


def arm_alone(measured: Measurement, conditions: Conditions, robot: Robot) -> Measurement:
    """Return a measurement whose torque is that of the arm itself, so that recordings share its parameters.

    tau - Y_last pi_payload of a known payload. With another gravity than the robot's the motion carries it, and what
    the URDF's inertias need there beyond its base parameters is taken off: no recording in the usual pose shows it.
    At drives of unknown gain the payload stays: it is what tells the gain.
    """
    motion = measured.motion
    if conditions.gravity is not None:
        motion = replace(motion, gravity=conditions.gravity)
    extra = beyond_base(motion, robot) + _of_payload(conditions, motion, robot)
    notes = conditions.notes(off=bool(robot.compares_with_newton_metres.any()))
    if conditions.assumed:
        notes = tuple(f"{measured.source}: {note}" for note in notes)
    alone = _less(measured, extra)
    return replace(alone, motion=motion, notes=(*measured.notes, *notes), conditions=conditions)


def beyond_base(motion: Motion, robot: Robot) -> Array:
    """Return the torque [N, n] Nm that the URDF's links need beyond what their base parameters say, where a motion has
    another gravity than the robot; 0 elsewhere. `arm_alone` takes it off.
    """
    if motion.gravity is None:
        return np.zeros_like(motion.q)
    base = reduce_to_base(robot)
    columns = robot.rigid.regressor(motion)
    known = base.values(robot.rigid.parameters, np.zeros(robot.n))
    return np.asarray(columns @ robot.rigid.parameters - columns[:, :, list(base.columns)] @ known)


def with_payload(measured: Measurement, robot: Robot) -> Measurement:
    """Return a measurement of `arm_alone` with the torque of its known payload in it, as it was measured."""
    return _less(measured, -_of_payload(measured.conditions, measured.motion, robot))


def less_payload(measured: Measurement, payload: KnownPayload | None, robot: Robot) -> Measurement:
    """Return a measurement of `arm_alone` with the torque of another payload taken off than what was taken off before,
    None: with its payload in it.
    """
    conditions = replace(measured.conditions, payload=payload)
    whole = with_payload(measured, robot)
    return replace(_less(whole, _of_payload(conditions, measured.motion, robot)), conditions=conditions)


def _less(measured: Measurement, torque: Array) -> Measurement:
    """Return a measurement less a torque [N, n] Nm, in its mean and in every period."""
    single = measured.period_torque
    return replace(measured, torque=measured.torque - torque, period_torque=None if single is None else single - torque)


def _of_payload(conditions: Conditions, motion: Motion, robot: Robot) -> Array:
    """Return the torque [N, n] Nm of a known payload at the drives whose effort compares with it."""
    known = robot.compares_with_newton_metres
    if conditions.payload is None or not known.any():
        return np.zeros_like(motion.q)
    return np.asarray(known * conditions.payload.torque(robot, motion))

"""From a recording to a measurement: checked, put on its clock, periods or cycles averaged, or one pass low-passed.

Whether it repeats as a whole, or only its commanded motion does, is decided by what would be left over. What doesn't
repeat is differentiated and low-passed without phase.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from robot_ident.errors import InputError
from robot_ident.recording.averaging import average, cycles_instead
from robot_ident.recording.checks import check_efforts, check_plausible, check_samples, without_leaps
from robot_ident.recording.clock import Clock, even_positions, even_samples, rate_note, read_clock, roughness
from robot_ident.recording.effort import at_the_joints
from robot_ident.recording.frozen import bridged, find_frozen, without_frozen
from robot_ident.recording.measurement import DEFAULT_LOW_PASS, Measurement, Processing, arm_alone, time_scale
from robot_ident.recording.period import find_period, refine_period, turning_on
from robot_ident.recording.periodic import at_rest, averaged, averaged_cycles, trusted
from robot_ident.recording.recording import Recording
from robot_ident.recording.repairs import repaired
from robot_ident.recording.resolution import coarse_notes, position_step
from robot_ident.recording.saturation import without_clipped
from robot_ident.recording.torque_channel import chain_of
from robot_ident.robot.robot import Robot
from robot_ident.signals.derivatives import step
from robot_ident.signals.filters import ZeroPhaseLowPass, there_and_back
from robot_ident.signals.fourier import power_spectrum
from robot_ident.signals.motion import Array, Mask, Motion

_STRAY = 30.0  # times its noise: how far the position may stray from one period to the next
_BURSTS = 8.0  # kurtosis of the torque's scatter about the mean period; noise has 3, coloured noise little more
_SPREAD = np.sqrt(np.log(2.0) / 2.0) / np.pi  # times 1 / f: standard deviation of a Gaussian kernel of half gain at f
_LINES = 32  # whose mean power holds a chi-square of 64 degrees of freedom: noise alone doubles it once in 10^6
_ABOVE = 2.0  # times the noise: motion is there
_SMOOTH = 0.5  # correlation of that scatter from one sample to the next; bursts last longer than a sample


def disturbed(measured: Measurement, step: Array) -> tuple[int, ...]:
    """Return the joints whose torque has bursts of its own in each period and moves the arm by them.

    measured: periods averaged. step [n]: noise of a position sample, judged from sample to sample. Such torque (pushes,
    contacts, added pulses) is no noise: averaging blurs it, and its scatter would pass for a noise floor.
    """
    periods = measured.period_torque
    if periods is None:
        return ()
    found = []
    for joint in range(periods.shape[2]):
        x = periods[:, :, joint] - np.nanmean(periods[:, :, joint], axis=0)
        power = float(np.nanmean(x**2))
        if not power > 0.0:
            continue
        bursts = float(np.nanmean(x**4)) / power**2
        smooth = float(np.nanmean(x[:, 1:] * x[:, :-1])) / power
        strays = np.sqrt(measured.position_variance[joint]) > _STRAY * step[joint]
        if strays and bursts > _BURSTS and smooth > _SMOOTH:
            found.append(joint)
    return tuple(found)


@dataclass(frozen=True)
class Opened:
    """A recording at a robot's joints and on its clock, which all ways to process it share.

    given: as it was read; published: its efforts as the drives report them. q [N, n]: positions on the even grid.
    stands, said: rows in which an effort is frozen, and what it says then. steps [n]: of the encoders.
    """

    given: Recording
    recording: Recording
    published: Recording
    robot: Robot
    clock: Clock
    q: Array
    steps: Array
    stands: Mask | None
    said: dict[int, str]
    motion_only: bool

    @classmethod
    def of(cls, recording: Recording, robot: Robot, *, motion_only: bool = False) -> Opened:
        """Return a recording checked and repaired; motion_only: its efforts aren't used, so that they may say nothing.

        Raises InputError on a missing joint, wrong units, an effort that never changes, or a recording too short.
        """
        given, recording = recording, repaired(recording.with_joints(robot.joints), robot)
        if not motion_only:
            check_efforts(recording)
        check_samples(recording, motion_only=motion_only)
        recording = without_leaps(recording)
        stands, said = find_frozen(recording, _units(robot)) if not motion_only else (None, {})
        if stands is not None and said:
            recording = bridged(recording, stands)
        published = recording
        recording = at_the_joints(recording, robot, motion_only=motion_only)
        check_plausible(recording, robot)
        clock = read_clock(recording)
        q, steps = even_positions(recording, clock), position_step(recording.q)
        return cls(given, recording, published, robot, clock, q, steps, stands, said, motion_only)

    def processed(self, processing: Processing) -> Measurement:
        """Return even time, derivatives, averaged torque and its noise.

        Raises InputError on one that isn't periodic where it has to be, and on a low pass beyond half the sample rate.
        """
        recording, clock, robot = self.recording, self.clock, self.robot
        if processing.low_pass is not None and not 0 < processing.low_pass < 0.5 / clock.dt:
            raise InputError(
                f"{recording.source}: low pass of {processing.low_pass:g} Hz;"
                f" it must lie below half the sample rate, {0.5 / clock.dt:g} Hz"
            )
        made, note = _averaged(recording, clock, self.q, robot, processing)
        if made is None:
            made = low_passed(recording, clock, robot, processing)
        if not self.motion_only and robot.effort.coupling is None:
            made = without_clipped(made, self.published, clock)
        if self.stands is not None:
            made = without_frozen(made, self.stands, self.said, clock, robot)
        coarse = coarse_notes(self.steps, robot.drives.encoder_step, robot.joints)
        found = (line for line in (rate_note(self.q, clock.dt, robot.joints), *coarse, note) if line)
        made = replace(
            made,
            stamps=clock.stamps,
            sample_rate=1.0 / clock.dt,
            start_ns=recording.start_ns,
            notes=(*recording.notes, *clock.notes, *found, *made.notes),
            time_scale=time_scale(recording, processing.base_frequency),
            position_step=self.steps,
        )
        return arm_alone(made, recording.conditions, robot)


def process(
    recording: Recording, robot: Robot, processing: Processing | None = None, *, motion_only: bool = False
) -> Measurement:
    """Return what a recording says of a robot: even time, derivatives, averaged torque and its noise.

    motion_only: its efforts aren't used, so that they may say nothing. Raises InputError on a missing joint, wrong
    units, an effort that never changes, a recording too short, or one that isn't periodic where it has to be.
    """
    return Opened.of(recording, robot, motion_only=motion_only).processed(processing or Processing())


def _units(robot: Robot) -> tuple[str, ...]:
    """Return by joint the unit of efforts as they are published; none where they aren't torques."""
    plain = robot.effort.plain(robot.joints)
    return tuple(robot.torque_unit(joint) for joint in range(robot.n)) if plain else ()


def _averaged(
    recording: Recording, clock: Clock, q: Array, robot: Robot, processing: Processing
) -> tuple[Measurement | None, str]:
    """Return the mean of what repeats, by its period or cycle by cycle, None where the recording is to be taken as one
    pass, and why it is; q: its positions on the even grid.

    Raises InputError where periods are asked for and there are none.
    """
    if processing.periodic is False:
        return None, ""
    endless = turning_on(q, clock.dt, robot.joints)
    if endless and processing.periodic:
        raise InputError(f"{recording.source}: {endless}")
    if endless:
        return None, endless
    free = processing.base_frequency is None
    period = _period(recording, clock, q, processing)
    steady, mean, made, note = None, None, None, ""
    if period is not None:
        try:
            steady, mean = average(recording, clock, period)
        except InputError:
            if processing.periodic or not free:
                raise
            note = f"the motion repeats every {period * clock.dt:.4g} s, but for less than 2 periods"
    found = cycles_instead(recording, clock, q, mean) if free else None
    if found is not None:
        made, note = averaged_cycles(recording, clock, *found, robot, processing), ""
    elif steady is not None and mean is not None:
        made = averaged(recording, clock, steady, mean, robot, processing)
    if made is None and processing.periodic:
        raise InputError(f"{recording.source}: no period found; give --base-frequency, or record at least 2 periods")
    if made is not None and free and processing.periodic is None:
        joints = disturbed(made, roughness(q))
        if joints:
            names = ", ".join(robot.joints[joint] for joint in joints)
            every = "from cycle to cycle" if made.cycles else f"every {1 / (made.base_frequency or 1):.4g} s"
            return None, f"the motion repeats {every}, but not the torque of {names}"
    return made, note


def _period(recording: Recording, clock: Clock, q: Array, processing: Processing) -> float | None:
    """Return the period in samples, None where none is found."""
    if processing.base_frequency is None:
        return find_period(q, clock.dt)
    given = 1.0 / (processing.base_frequency * clock.dt)
    if len(q) < 2 * given - 2:
        raise InputError(
            f"{recording.source}: {len(q) / given:.1f} periods of {1 / processing.base_frequency:g} s;"
            " at least 2 are needed where periods are averaged"
        )
    refined = refine_period(q, given, clock.dt)
    found = find_period(q, clock.dt)
    if found is not None and abs(found - given) > 0.01 * given and abs(given / found - round(given / found)) > 0.01:
        raise InputError(
            f"{recording.source}: the motion repeats every {found * clock.dt:.4g} s,"
            f" not every {1 / processing.base_frequency:.4g} s: at {100 * given / found:.4g} % of its speed, or another"
            f" trajectory; --trajectory EXCITATION tells, or give --base-frequency {1 / (found * clock.dt):.6g}"
        )
    return refined if abs(refined - given) < 0.005 * given else given


def _velocity_bandwidth(motion: Motion, noise: Array) -> Array:
    """Return the bandwidth [n] Hz of velocities in which the time of a reversal is known best, 0 where there is none.

    The noise of positions [n] moves a reversal by sigma_v / |ddq|, sigma_v^2 = 8 pi^2 noise^2 dt f^3 / 3; the low pass
    spreads what sticks or leaps there by _SPREAD / f. The sum of both squares is least at
    f^5 = (_SPREAD |ddq| / noise)^2 / (4 pi^2 dt).
    """
    turns = motion.dq[1:] * motion.dq[:-1] < 0.0
    turning = np.sqrt(np.sum(motion.ddq[1:] ** 2 * turns, axis=0) / np.maximum(turns.sum(axis=0), 1))
    return np.asarray(((_SPREAD * turning / np.maximum(noise, 1e-12)) ** 2 / (4.0 * np.pi**2 * step(motion))) ** 0.2)


def _acceleration_error(q: Array, low_pass: ZeroPhaseLowPass, smoother: ZeroPhaseLowPass) -> Array:
    """Return the variance [n] (rad/s^2)^2 by which accelerations err as they are compared: position noise that passed
    the smoother H, and motion that it took, 2 / N sum_f w^4 G^2 (H^2 s^2 + (1 - H)^2 (P - s^2)), G the low pass, P the
    spectrum of the positions q [N, n] where it stands above that of their noise s^2.
    """
    from scipy.ndimage import uniform_filter1d

    noise, power = roughness(q) ** 2, power_spectrum(q)
    level = uniform_filter1d(power, _LINES, axis=0, mode="nearest")
    moved = np.where(level > _ABOVE * noise, np.maximum(power - noise, 0.0), 0.0)
    frequency = np.fft.rfftfreq(len(q), low_pass.dt)
    passed, kept = (there_and_back(frequency, one.cutoff) for one in (low_pass, smoother))
    scale = ((2.0 * np.pi * frequency) ** 4 * passed**2)[:, None]
    errors = scale * (kept[:, None] ** 2 * noise + (1.0 - kept[:, None]) ** 2 * moved)
    return np.asarray(2.0 / len(q) * errors.sum(axis=0))


def _velocities_in_words(bandwidths: Array, wide: float) -> str:
    """Return to which bandwidths [Hz] velocities were differentiated, nothing where to that of accelerations."""
    least, most = f"{bandwidths.min():.3g}", f"{bandwidths.max():.3g}"
    if bandwidths.max() <= wide:
        return ""
    return f", velocities to {least} Hz" if least == most else f", velocities to {least} to {most} Hz"


def low_passed(recording: Recording, clock: Clock, robot: Robot, processing: Processing) -> Measurement:
    """Return a non-periodic recording with the derivatives of its low-passed positions.

    Positions pass a low pass of their own (by default 4 times the cutoff) before they are differentiated twice, and a
    wider one for velocities, whose sign is friction's; torque and columns then pass the same cutoff. Rows near gaps and
    near the ends, where the filter has no data, don't count, nor do those whose direction neither velocity is sure of:
    the wider one has more noise, where a joint moves slowly and reverses sharply.
    """
    q, tau, present = even_samples(recording, clock)
    nyquist = 0.5 / clock.dt
    cutoff = processing.low_pass or min(DEFAULT_LOW_PASS, 0.4 * nyquist)
    wide = processing.derivative_bandwidth or min(4.0 * cutoff, 0.8 * nyquist)
    chain = chain_of(robot, processing.anti_alias, recording.source, 1.0 / clock.dt, 1.0 / (len(q) * clock.dt))
    if not chain.trivial:
        chain.check_low_pass(cutoff, recording.source)
        tau = chain.undone(tau, 1.0 / clock.dt)
    raw, smoother = q, ZeroPhaseLowPass(wide, clock.dt, len(q))
    noise = roughness(q)
    smooth = Motion(smoother.apply(q), smoother.apply(q, 1), smoother.apply(q, 2), dt=clock.dt)
    given = processing.velocity_bandwidth
    found = _velocity_bandwidth(smooth, noise) if given is None else np.full(len(noise), given)
    finest = np.clip(found, wide, max(wide, 0.8 * nyquist))
    fine = [ZeroPhaseLowPass(float(one), clock.dt, len(q)) for one in finest]
    q, dq = (np.stack([one.apply(x, k) for one, x in zip(fine, q.T, strict=True)], axis=1) for k in (0, 1))
    motion = replace(smooth, q=q, dq=dq)
    certain = trusted(motion, robot, processing, noise * [one.noise_gain(1) for one in fine])
    certain |= trusted(smooth, robot, processing, noise * smoother.noise_gain(1)) & (dq * smooth.dq > 0.0)
    low_pass = ZeroPhaseLowPass(cutoff, clock.dt, len(q))
    reach = low_pass.smear()
    missing = np.concatenate([[0], np.ones(reach), ~present, np.ones(reach)]).cumsum()  # beyond both ends as well
    whole = (missing[2 * reach + 1 :] - missing[: -2 * reach - 1] < 0.5)[:, None]  # no missing sample within reach
    notes = [
        f"taken as one pass, not by periods: low-passed at {cutoff:g} Hz, differentiated to {wide:g} Hz"
        + _velocities_in_words(finest, wide)
    ]
    if chain.note:
        notes.append(chain.note)
    if not present.all():
        notes.append(f"{int((~whole).sum())} rows near gaps and ends left out")
    return Measurement(
        source=recording.source,
        joints=recording.names,
        dt=clock.dt,
        motion=motion,
        torque=tau,
        used=certain & whole,
        standstill=at_rest(smooth, robot),
        torque_variance=np.full(robot.n, np.nan),
        position_variance=np.full(robot.n, np.nan),
        low_pass=low_pass,
        acceleration_error=_acceleration_error(raw, low_pass, smoother),
        samples_per_period=len(q),
        decimate=processing.decimate,
        notes=tuple(notes),
    )

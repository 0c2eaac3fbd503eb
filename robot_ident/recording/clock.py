"""The clock of a recording: were the samples taken unevenly, or only stamped so, and often enough for the motion?

A stamp t_k = a + b k + e_k with jitter e_k. Where the robot samples evenly and stamps late, taking e_k at face value
puts an error dq e_k on the position; where it samples unevenly, ignoring e_k does. The clock is taken that leaves the
smaller residual of the positions about a smooth motion: r on the even clock, r - dq e as stamped.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from robot_ident.errors import InputError
from robot_ident.recording.recording import Recording
from robot_ident.signals.motion import Array, Mask

_EVEN = 2e-3  # jitter below this share of the sample time is of no consequence
_TWO_RATES = 1.5  # ratio of sample times within one recording that no jitter or loss explains
_FASTEST, _SLOWEST = 1e-6, 1.0  # s between samples: all else is another unit
_SPARSE = 20.0  # places of the grid for each sample, above which the stamps make no grid
_GAP = 10.0  # times its length: no recording has a longer hole
_TELLS = 25.0  # (dq e)^2 over the positions' noise, summed: below, noise hides which clock is right
_NEAR, _FAR = 9, 51  # samples of which most must be shifted for samples to be lost: few, where many are, and many
_ROUGHNESS = 9  # samples of the local cubic fit that tells roughness from motion


@dataclass(frozen=True)
class Stamps:
    """What the stamps of a recording are worth.

    kind: `even` (no jitter that matters), `late` (sampled evenly, stamped late), `true` (stamped when sampled), or
    `untold` where noise hides which. jitter: rms [s] about the even clock. even, stamped: residual of the positions
    about a smooth motion on either clock, rms [rad], of the joint where they differ most; None where neither was
    looked at.
    """

    kind: str
    jitter: float
    even: float | None = None
    stamped: float | None = None

    def to_dict(self) -> dict[str, Any]:
        """Return plain data."""
        return {
            "stamps": self.kind,
            "jitter": self.jitter,
            "residual_even": self.even,
            "residual_stamped": self.stamped,
        }

    @property
    def note(self) -> str:
        """Which clock is used, and why; empty where there is nothing to say."""
        size = f"{self.jitter * 1e3:.2f} ms rms"
        if self.kind == "even":
            return ""
        if self.kind == "untold":
            return f"stamps jitter by {size}, too little to matter; even clock used"
        if self.even is None or self.stamped is None:
            return f"the sampling jitters by {size} as stamped; stamps used"
        told = f"position residual {self.even:.2g} on the even clock, {self.stamped:.2g} as stamped"
        if self.kind == "late":
            return f"stamps jitter by {size}, the sampling does not: {told}; even clock used"
        return f"the sampling jitters by {size} as stamped: {told}; stamps used"


@dataclass(frozen=True)
class Clock:
    """The times at which the samples were taken.

    dt: sample time [s]. t [N]: times of the samples. index [N]: place of each sample on the even grid, or None when
    the sampling itself is uneven. missing: samples that the grid has and the recording lacks. stamps: what they are
    worth. notes: what was decided and why.
    """

    dt: float
    t: Array
    index: np.ndarray | None
    missing: int
    stamps: Stamps
    notes: tuple[str, ...]


def read_clock(recording: Recording) -> Clock:
    """Return the clock of a recording; InputError when there are too few samples for one."""
    t = recording.t
    if len(t) < 20:
        raise InputError(f"{recording.source}: {len(t)} samples are too few to identify anything")
    _check_stamps(recording)
    index, start, dt = _grid(t)
    if index[-1] + 1 > _SPARSE * len(index):
        raise InputError(
            f"{recording.source}: {len(index)} samples, mostly {dt:.3g} s apart, last {t[-1] - t[0]:.4g} s;"
            " their stamps tell no sample rate"
        )
    jitter = t - (start + dt * index)
    missing = int(index[-1] - index[0] + 1 - len(index))
    lost = (f"{missing} of {index[-1] - index[0] + 1} samples are missing",) if missing else ()
    stamps = _judged(recording, index, jitter, dt)
    notes = (*lost, stamps.note) if stamps.note else lost
    if stamps.kind == "true":
        return Clock(dt, t, None, missing, stamps, notes)
    return Clock(dt, start + dt * index, index, missing, stamps, notes)


def fill(values: Array, index: np.ndarray) -> Array:
    """Return values [N, n] on the whole even grid, gaps filled in a straight line."""
    grid = np.arange(index[0], index[-1] + 1)
    if len(grid) == len(index):
        return values
    return np.column_stack([np.interp(grid, index, column) for column in values.T])


def even_positions(recording: Recording, clock: Clock) -> Array:
    """Return positions [K, n] on an even grid of the clock's sample time, gaps bridged."""
    if clock.index is not None:
        return fill(recording.q, clock.index)
    grid = np.arange(clock.t[0], clock.t[-1] + 0.5 * clock.dt, clock.dt)
    return np.column_stack([np.interp(grid, clock.t, column) for column in recording.q.T])


def roughness(q: Array) -> Array:
    """Return the noise of positions q [N, n] on an even grid [n]: third differences hold 20 times its variance and
    little motion.
    """
    return np.array([np.sqrt(np.mean(np.diff(column, n=3) ** 2) / 20.0) for column in q.T])


def _check_stamps(recording: Recording) -> None:
    """Raise InputError where the stamps can't be seconds of one recording at one sample rate."""
    steps = np.diff(recording.t)
    rates = np.array([1.0 / np.median(piece) for piece in np.array_split(steps, 8)])
    if rates.max() > _TWO_RATES * rates.min() and len(steps) >= 199:
        other = rates[np.argmax(np.abs(np.log(rates / rates[0])))]
        raise InputError(
            f"{recording.source}: the sample rate changes from {rates[0]:.4g} Hz to {other:.4g} Hz on the way;"
            " give each part as a recording"
        )
    usual = float(np.median(steps))
    if not _FASTEST <= usual <= _SLOWEST:
        raise InputError(f"{recording.source}: a sample every {usual:.3g} s; are its times in seconds?")
    longest = int(np.argmax(steps))
    if steps[longest] > _GAP * len(steps) * usual:
        at = recording.t[longest] - recording.t[0]
        raise InputError(
            f"{recording.source}: a gap of {steps[longest]:.3g} s after {at:.3f} s; cut the recording there into two"
        )


def _grid(t: Array) -> tuple[np.ndarray, float, float]:
    """Return (index [N], start, dt) of the even grid nearest to the stamps, gaps allowed.

    A first guess of dt that is off slips whole samples; of several guesses the grid with the least jitter is kept, the
    first one whose jitter is of no consequence.
    """
    steps = np.diff(t)
    median = float(np.median(steps))
    mean = float(steps[steps < 1.5 * median].mean())  # jitter cancels in it, lost samples aren't in it
    guesses = [(guess, length, _NEAR) for guess in (median, mean) for length in (40, 100)]
    guesses.append((float(steps.mean()), len(t), _FAR))  # right where nothing is lost, however late stamps are
    tried = []
    for guess in guesses:
        index, start, dt = _grown(t, *guess)
        tried.append((float(np.sqrt(np.mean((t - start - dt * index) ** 2))) / dt, (index, start, dt)))
        if tried[-1][0] < _EVEN:
            break
    return min(tried, key=lambda grid: grid[0])[1]


def _grown(t: Array, dt: float, length: int, around: int) -> tuple[np.ndarray, float, float]:
    """Return the grid that grows from a first guess of dt: the stretch that sets dt doubles until it is all of t."""
    start, length = float(t[0]), min(len(t), length)
    while True:
        index = _place(t[:length], start, dt, around)
        dt, start = (float(c) for c in np.polyfit(index, t[:length], 1))
        if length == len(t):
            break
        length = min(2 * length, len(t))
    index = _place(t, start, dt, around)
    dt, start = (float(c) for c in np.polyfit(index, t, 1))
    return index - index[0], start + dt * index[0], dt


def _place(t: Array, start: float, dt: float, around: int) -> np.ndarray:
    """Return strictly increasing places on the grid: lost samples shift all later ones, a jump that comes back
    within half of `around` samples shifts none.
    """
    from scipy.ndimage import median_filter

    order = np.arange(len(t))
    shift = median_filter(np.rint((t - start) / dt).astype(np.int64) - order, size=around, mode="nearest")
    return np.asarray(np.maximum.accumulate(shift) + order)


def _judged(recording: Recording, index: np.ndarray, jitter: Array, dt: float) -> Stamps:
    """Return what stamps are worth, by the residual r of the positions on the even clock and r - dq e as stamped.

    Joints are weighed by their roughness. Where dq e is too small beside the noise to tell, the even clock stands.
    """
    size = float(np.sqrt(np.mean(jitter**2)))
    if size < _EVEN * dt:
        return Stamps("even", size)
    if index[-1] + 1 < 3 * _ROUGHNESS or index[-1] + 1 > 4 * len(index):
        return Stamps("true", size)
    from scipy.signal import savgol_filter

    q = fill(recording.q, index)
    e = fill(jitter[:, None], index)[:, 0]

    def rough(x: Array) -> Array:
        return x - np.asarray(savgol_filter(x, _ROUGHNESS, 3, axis=0))

    speed = savgol_filter(q, 2 * _ROUGHNESS + 1, 3, deriv=1, delta=dt, axis=0)
    r, x = rough(q), rough(speed * e[:, None])
    weight = 1.0 / np.maximum(np.var(r, axis=0), 1e-24)
    even, stamped = (np.sqrt(np.mean(part**2, axis=0)) for part in (r, r - x))
    worst = int(np.argmax(np.abs(np.log(np.maximum(even, 1e-15) / np.maximum(stamped, 1e-15)))))
    shown = float(even[worst]), float(stamped[worst])
    if float(np.sum(weight * np.sum(x * x, axis=0))) < _TELLS:
        return Stamps("untold", size, *shown)
    return Stamps("late" if np.sum(weight * (even**2 - stamped**2)) < 0.0 else "true", size, *shown)


_SHARE = 0.02  # of the acceleration's power that may lie above the part of the band that sampling leaves usable
_TOP = 0.2  # of the sample rate: the low pass of what does not repeat lies there
_ARM = 20.0  # Hz: no arm accelerates faster on purpose
_FLOOR = 0.2  # share of the lines above it whose power is taken for noise and aliases
_COARSE = 2e-3  # of a joint's range: noise that no encoder has, so that it is motion folded back
_LEAST = 64  # samples
_NEIGHBOURS = 9  # lines that are averaged; with fewer up there, nearly all of the band is usable


def fast_share(q: Array, dt: float) -> Array:
    """Return the share [n] of each joint's acceleration power above a fifth of the sample rate (to 20 Hz), noise taken
    out.

    Power of a line: (2 pi f)^4 |q(f)|^2, less a white floor, the level of the weakest fifth of the lines up there. A
    floor beyond any encoder's noise is motion folded back and counts as 1.
    """
    n = q.shape[1]
    if len(q) < _LEAST or _TOP / dt >= _ARM:
        return np.zeros(n)
    from scipy.ndimage import uniform_filter1d

    window = np.hanning(len(q))[:, None]
    ramp = np.linspace(0.0, 1.0, len(q))[:, None]
    rest = q - (q[0] + ramp * (q[-1] - q[0]))
    frequency = np.fft.rfftfreq(len(q), dt)
    power = np.abs(np.fft.rfft((rest - rest.mean(axis=0)) * window, axis=0)) ** 2
    power = uniform_filter1d(power, _NEIGHBOURS, axis=0, mode="nearest")  # lest single lines of noise count as motion
    top = (frequency >= _TOP / dt) & (frequency <= _ARM)
    if top.sum() < _NEIGHBOURS:
        return np.zeros(n)
    floor = np.quantile(power[top], _FLOOR, axis=0)
    above = (2.0 * np.pi * frequency[:, None]) ** 4 * np.maximum(power - 3.0 * floor, 0.0)
    above[frequency > _ARM] = 0.0
    total = above.sum(axis=0)
    share = above[top].sum(axis=0) / np.where(total > 0.0, total, 1.0)
    noise = np.sqrt(np.maximum(floor, 0.0) / np.sum(window**2))
    reach = np.ptp(q, axis=0)
    return np.where((reach > 1e-6) & (noise > _COARSE * reach), 1.0, share)


def rate_note(q: Array, dt: float, joints: tuple[str, ...]) -> str:
    """Return a line that names the joints which move faster than the samples of q [N, n] can follow; empty if none."""
    share = fast_share(q, dt)
    slow = [name for name, part in zip(joints, share, strict=True) if part > _SHARE]
    if not slow:
        return ""
    return (
        f"{1.0 / dt:.4g} Hz is too low a rate for the motion of {', '.join(slow)}: their acceleration changes"
        " between samples, so that inertia is seen blurred; record faster, or move more gently"
    )


def even_samples(recording: Recording, clock: Clock) -> tuple[Array, Array, Mask]:
    """Return positions, torques and which samples are real, on an even grid."""
    if clock.index is not None:
        present = np.zeros(clock.index[-1] - clock.index[0] + 1, dtype=bool)
        present[clock.index - clock.index[0]] = True
        return fill(recording.q, clock.index), fill(recording.tau, clock.index), present
    from scipy.interpolate import make_interp_spline

    grid = np.arange(clock.t[0], clock.t[-1], clock.dt)
    both = make_interp_spline(clock.t, np.hstack([recording.q, recording.tau]), k=3)(grid)
    nearest = np.searchsorted(clock.t, grid).clip(1, len(clock.t) - 1)
    present = clock.t[nearest] - clock.t[nearest - 1] < 2.5 * clock.dt
    n = recording.q.shape[1]
    return both[:, :n], both[:, n:], present

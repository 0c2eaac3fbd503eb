"""What is played: a motion that was certified for its robot, its slower rehearsals, and its periods as they are
counted.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from robot_ident.errors import InputError
from robot_ident.limits.certifier import certify
from robot_ident.planning.blends import Playback
from robot_ident.playback.player import Phase, Player, end_of
from robot_ident.robot import Robot
from robot_ident.signals.motion import Array, Motion
from robot_ident.trajectories.excitation import Excitation, Reference
from robot_ident.trajectories.point_to_point import load_motion


@dataclass(frozen=True)
class Slowed:
    """The same path at a share s of the speed, 0 < s <= 1: q(s t), s dq(s t), s^2 ddq(s t), within the same limits."""

    motion: Reference
    speed: float

    @property
    def duration(self) -> float:
        """Length [s]."""
        return self.motion.duration / self.speed

    @property
    def start_pose(self) -> Array:
        """Position at the start [n] rad."""
        return self.motion.start_pose

    def reference(self, t: Array) -> Motion:
        """Return the motion at t [N] s."""
        m = self.motion.reference(t * self.speed)
        return Motion(m.q, self.speed * m.dq, self.speed**2 * m.ddq)


_USUAL_RATE = 150.0  # Hz
_BACK = 1e-6  # rad or m: a motion that ends there has come back


@dataclass(frozen=True)
class Plan:
    """A certified motion of a robot, the motions that go before it, and the rate [Hz] that it was made for.

    unchecked: what no certificate covers, in words.
    """

    robot: Robot
    motion: Reference
    rehearsals: tuple[Slowed, ...]
    rate: float
    unchecked: tuple[str, ...]


def load_plan(
    path: str | Path, robot: Robot, *, periods: int, speed: float = 1.0, rehearsals: Sequence[float] = ()
) -> Plan:
    """Return the plan that plays `periods` periods of an excitation, or a validation motion, at a share of its speed.

    rehearsals: shares of the designed speed at which one period is played first, none slower than the one before it (0:
    none). InputError when they fall, the motion doesn't end where it begins, or a limit of the robot isn't kept.
    """
    if any(later < earlier for earlier, later in pairwise(share for share in rehearsals if share > 0.0)):
        raise InputError(
            f"rehearsal = {list(rehearsals)}: slow ones come first, each as fast as the one before it or faster:"
            f" {sorted(rehearsals)}"
        )
    loaded = load_motion(path)
    loaded.check_robot(robot)
    once = Playback(loaded, robot, 1) if isinstance(loaded, Excitation) else loaded
    margins = certify(once, robot)
    if not margins.kept:
        raise InputError(f"{path}: not certified for robot {robot.name}: {margins.violations[0]}")
    way = np.abs(end_of(once) - once.start_pose)
    if any(rehearsals) and way.max() > _BACK:
        joint = robot.joints[int(np.argmax(way))]
        raise InputError(
            f"rehearsal = {list(rehearsals)}: {path} ends {way.max():.3g} from its start at {joint}, so that it"
            " can't be played twice in a row; rehearse it by speed, in a run of its own"
        )
    motion: Reference = Playback(loaded, robot, periods) if isinstance(loaded, Excitation) else loaded
    return Plan(
        robot,
        Slowed(motion, speed) if speed < 1.0 else motion,
        tuple(Slowed(once, share) for share in rehearsals if share > 0.0),
        loaded.sample_rate if isinstance(loaded, Excitation) else _USUAL_RATE,
        tuple(margins.unknown),
    )


_MOVES = 1e-2  # rad; a motion smaller than this is a robot at rest, which repeats itself trivially
_ALIKE = 3e-3  # share of the range of a joint within which two periods are the same
_NOISE = 3e-4  # rad by which they may differ in any case
_GLITCH = 0.03  # share of a period for which they may differ by more
_SURE = 0.05  # share of a period by which the last one is waited for
_LOOKS = 16  # times a period that the range of the motion is looked at


class PeriodCounter:
    """Says how many whole periods in a row a robot has repeated: q(t) = q(t - T).

    It only decides *when* to identify; which samples are steady is judged again, and finer, from the whole recording.
    """

    def __init__(self, period: float) -> None:
        """Count periods of `period` [s]."""
        self.period = period
        self._samples: deque[tuple[float, Array]] = deque()
        self._since: float | None = None
        self._agreed = -np.inf
        self._range: Array = np.zeros(1)
        self._looked = -np.inf
        self._told = False

    @property
    def periods(self) -> float:
        """Periods that the present stretch of repetition covers, 0 where nothing moves or repeats."""
        return 0.0 if self._since is None else (self._agreed - self._since) / self.period + 1.0

    def add(self, t: float, q: Array, wanted: int = 0) -> bool:
        """Take in the positions [n] at t [s]; return whether it is time to identify, once a stretch of repetition.

        It is when `wanted` whole periods have been seen, or when the repetition ends after at least two. A time that
        runs backwards begins anew.
        """
        if self._samples and t <= self._samples[-1][0]:
            self._samples.clear()
            self._since, self._looked = None, -np.inf
        self._samples.append((t, q))
        before = self._position(t - self.period)
        if before is None:
            return False
        if t - self._looked > self.period / _LOOKS:
            self._looked = t
            self._range = np.ptp(np.array([sample[1] for sample in self._samples]), axis=0)
        if not np.any(self._range > _MOVES):
            self._since = None
            return False
        if np.all(np.abs(q - before) <= _ALIKE * self._range + _NOISE):
            if self._since is None:
                self._since, self._told = t, False
            self._agreed = t
            return not self._told and wanted > 0 and self._tell(wanted + _SURE)
        if self._since is None or t - self._agreed <= _GLITCH * self.period:
            return False
        due = not self._told and self._tell(1.8)
        self._since = None
        return due

    def _tell(self, least: float) -> bool:
        self._told = self.periods >= least
        return self._told

    def _position(self, t: float) -> Array | None:
        """Return the positions at an earlier time, between two samples, and forget what is older."""
        samples = self._samples
        while len(samples) > 2 and samples[1][0] <= t:
            samples.popleft()
        (t0, q0), (t1, q1) = samples[0], samples[min(1, len(samples) - 1)]
        if not t0 <= t < t1:
            return None
        share = (t - t0) / (t1 - t0)
        return q0 + share * (q1 - q0)


def progress(player: Player) -> str:
    """Return the phase, and while a motion is played its speed and period."""
    if player.phase is not Phase.PLAYING:
        return player.phase.value
    t, played, what = player.elapsed, player.motions[max(player.number, 0)], "playing"
    if isinstance(played, Slowed):
        what = f"playing at {played.speed:.0%}"
        t, played = t * played.speed, played.motion
    if not isinstance(played, Playback):
        return f"{what}, {t:.1f} of {played.duration:.1f} s"
    number = (t - played.transient) / played.excitation.period
    if number < 0:
        return f"{what}, blending in"
    if number >= played.periods:
        return f"{what}, blending out"
    return f"{what}, period {int(number) + 1} of {played.periods}"

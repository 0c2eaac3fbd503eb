"""Watches the robot while it is moved: is it still there, is it where it was sent, at full speed, and is its torque,
or the current of its drives, within bounds.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from robot_ident.recording.effort import joint_torque
from robot_ident.robot import Robot
from robot_ident.signals.motion import Array

_REST_SPAN = 0.2  # s over which the speed of a robot is judged from its positions alone
_MUTE = 1.0  # s without an effort that comes by messages of its own, of which some drivers send few
_REST_SPEED = 0.02  # rad/s: stands still, as in a validation


@dataclass(frozen=True)
class Bounds:
    """A motion is stopped without a new state for `timeout` [s], `tracking` [n] rad off, beyond `effort` [n]: Nm, or A
    of a drive of unknown gain.
    """

    timeout: float
    tracking: Array
    effort: Array


@dataclass(frozen=True)
class State:
    """What the robot reported: q [n] rad, tau [n] in its bounds' unit (nan: none), its stamp [ns], when it came [s]."""

    q: Array
    tau: Array
    stamp_ns: int
    received: float


class Watch:
    """Keeps the robot's latest state and says what is wrong with it.

    A message that lacks one of the joints belongs to another device and is passed over; one that repeats the stamp of
    its predecessor is no news. A NaN is remembered until `clear`.
    """

    def __init__(
        self,
        joints: Sequence[str],
        bounds: Bounds,
        *,
        convert: Callable[[Array, Array], Array] = lambda reported, q: reported,
        units: Sequence[str] = (),
        elsewhere: Sequence[str] = (),
    ) -> None:
        """Watch these joints; `bounds` may be replaced at any time.

        convert(reported [n], q [n] rad) gives efforts in the unit of their bounds, `units` for messages. elsewhere:
        joints whose effort comes by `update_efforts`.
        """
        self.joints = tuple(joints)
        self.bounds = bounds
        self._convert = convert
        self._units = tuple(units) or ("",) * len(self.joints)
        self._elsewhere = {joint: self.joints.index(joint) for joint in elsewhere}
        self._reported: Array = np.full(len(self.joints), np.nan)
        self._told: Array = np.full(len(self.joints), np.inf)  # s, when each of them came
        self.worst_tracking: Array = np.zeros(len(self.joints))
        self.worst_effort: Array = np.zeros(len(self.joints))
        self._lock = threading.Lock()
        self._recent: deque[State] = deque()
        self._order: tuple[tuple[str, ...], list[int]] = ((), [])
        self._fault = ""
        self._hint = ""

    def update(
        self, names: Sequence[str], position: Sequence[float], effort: Sequence[float], stamp_ns: int, now: float
    ) -> None:
        """Take one joint state in, received at `now` [s]."""
        pick = self._pick(tuple(names), len(position))
        if pick is None:
            return
        q = np.asarray(position, dtype=float)[pick]
        complete = len(effort) == len(names)
        reported = np.asarray(effort, dtype=float)[pick] if complete else np.full(len(pick), np.nan)
        places = list(self._elsewhere.values())
        with self._lock:
            reported[places] = self._reported[places]
            lacking = np.isnan(reported) & complete
            lacking[places] = False
            if not np.isfinite(q).all() or lacking.any():
                what, values = ("position", q) if not np.isfinite(q).all() else ("effort", reported)
                joint = int(np.argmin(np.isfinite(q) if what == "position" else ~lacking))
                self._fault = f"the {what} of {self.joints[joint]} is {values[joint]}"
                return
            if self._recent and stamp_ns and stamp_ns <= self._recent[-1].stamp_ns:
                self._hint = (
                    "; their stamps stand still"
                    if stamp_ns == self._recent[-1].stamp_ns
                    else "; their stamps run backwards"
                )
                return
            self._hint = ""
            tau = reported if np.isnan(reported).all() else self._convert(reported, q)
            self._recent.append(State(q, tau, stamp_ns, now))
            while len(self._recent) > 2 and now - self._recent[1].received >= _REST_SPAN:
                self._recent.popleft()

    def update_efforts(self, values: Mapping[str, float], now: float) -> None:
        """Take in efforts, as reported, that come by messages of their own, at `now` [s]."""
        with self._lock:
            for joint, value in values.items():
                place = self._elsewhere[joint]
                self._reported[place], self._told[place] = value, now

    @property
    def unheard(self) -> tuple[str, ...]:
        """The joints that have a bound of their effort but report none."""
        state = self.state
        tau = np.full(len(self.joints), np.nan) if state is None else state.tau
        there = np.isfinite(tau) | ~np.isfinite(self.bounds.effort)
        return tuple(joint for joint, heard in zip(self.joints, there, strict=True) if not heard)

    def _pick(self, names: tuple[str, ...], positions: int) -> list[int] | None:
        if names != self._order[0]:
            missing = [joint for joint in self.joints if joint not in names]
            if missing or positions != len(names):
                if not self._recent:
                    self._hint = (
                        f"; those that come lack {missing[0]}" if missing else "; their positions don't fit their names"
                    )
                return None
            self._order = (names, [names.index(joint) for joint in self.joints])
        return self._order[1] if positions == len(names) else None

    @property
    def state(self) -> State | None:
        """The latest state."""
        with self._lock:
            return self._recent[-1] if self._recent else None

    def clear(self) -> None:
        """Forget an earlier fault, at a start."""
        with self._lock:
            self._fault = ""
        self.measure_anew()

    def measure_anew(self) -> None:
        """Forget the worst tracking error and effort, at the start of each motion."""
        with self._lock:
            self.worst_tracking, self.worst_effort = np.zeros((2, len(self.joints)))

    def worst_share(self) -> tuple[float, str, str]:
        """Return the largest share of a bound that this motion has used, by which joint, and of which bound."""
        shares = {
            "tracking error": self.worst_tracking / self.bounds.tracking,
            "effort": self.worst_effort / self.bounds.effort,
        }
        what = max(shares, key=lambda name: float(shares[name].max()))
        joint = int(np.argmax(shares[what]))
        return float(shares[what][joint]), self.joints[joint], what

    def forget(self) -> None:
        """Forget the states as well: they are older than they look (this process stood still)."""
        with self._lock:
            self._recent.clear()
            self._told[:] = np.inf

    def excuse(self, seconds: float, now: float) -> None:
        """Don't count so many seconds of silence: time stood still, and nobody was expected to say anything."""
        with self._lock:
            heard = np.isfinite(self._told)
            self._told[heard] = np.minimum(self._told[heard] + seconds, now)
            for k, state in enumerate(self._recent):
                self._recent[k] = replace(state, received=min(state.received + seconds, now))

    def not_ready(self, now: float) -> str:
        """Return why no motion can start from here, or an empty text."""
        silence = self.silence(now) or self._mute(now)
        if silence:
            return silence
        with self._lock:
            recent = tuple(self._recent)
        span = recent[-1].received - recent[0].received if recent else 0.0
        if span < 0.5 * _REST_SPAN:
            return "the robot was seen for too short a time to know whether it stands still"
        speed = np.abs(recent[-1].q - recent[0].q) / span
        if speed.max() > _REST_SPEED:
            joint = int(np.argmax(speed))
            return f"{self.joints[joint]} moves at {speed[joint]:.3f} rad/s; the robot must stand still to start"
        return ""

    def silence(self, now: float) -> str:
        """Return for how long nothing was heard of the robot, or an empty text."""
        last = self.state
        if last is None:
            return f"no joint_states{self._hint}"
        age = now - last.received
        if age > self.bounds.timeout:
            return f"no new joint_states for {age:.2f} s{self._hint}"
        return ""

    def problem(self, now: float, commanded: Array) -> str:
        """Return why the motion must stop, or an empty text; commanded: as in `astray`."""
        problem = self._fault or self.astray(now, commanded)
        state = self.state
        if problem or state is None or not len(commanded):
            return problem
        self.worst_effort = np.fmax(self.worst_effort, np.abs(state.tau))
        if np.any(np.abs(state.tau) > self.bounds.effort):
            joint = int(np.nanargmax(np.abs(state.tau) - self.bounds.effort))
            unit = f" {self._units[joint]}" if self._units[joint] else ""
            bound = f"(bound {self.bounds.effort[joint]:.1f}{unit})"
            return f"the effort of {self.joints[joint]} is {state.tau[joint]:.1f}{unit} {bound}"
        return self._mute(now)

    def _mute(self, now: float) -> str:
        """Return which joint's effort came by messages of its own and comes no more, where it has a bound."""
        age = np.where(np.isfinite(self.bounds.effort), now - self._told, -np.inf)
        joint = int(np.argmax(age))
        if age[joint] <= max(self.bounds.timeout, _MUTE):
            return ""
        return f"no effort of {self.joints[joint]} for {age[joint]:.2f} s"

    def astray(self, now: float, commanded: Array) -> str:
        """Return why it isn't known that the robot is where it was sent, or an empty text.

        commanded [k, n] rad: the positions commanded lately. A robot follows with a delay, so what counts is the
        distance from the range that these cover.
        """
        state = self.state
        silence = self.silence(now)
        if silence or state is None or not len(commanded):
            return silence
        off = np.maximum(state.q - commanded.max(axis=0), commanded.min(axis=0) - state.q)
        self.worst_tracking = np.maximum(self.worst_tracking, off)
        if np.any(off > self.bounds.tracking):
            joint = int(np.argmax(off - self.bounds.tracking))
            bound = f"(bound {self.bounds.tracking[joint]:g})"
            return f"{self.joints[joint]} is {off[joint]:.4f} from where it was sent {bound}"
        return ""


class EffortLoad:
    """Torque at the joints in Nm (N), by the declared sign, gain, ratio and coupling; A of a drive of unknown gain.

    bounds [n]: the robot's limit of each joint in that unit, inf where nobody knows one. units [n].
    """

    def __init__(self, robot: Robot) -> None:
        """Take the robot's limits: torque where effort tells it, else the current that its YAML allows a drive."""
        ampere = np.array([robot.in_ampere(joint) for joint in range(robot.n)])
        current = np.array([robot.effort.of(joint).quantity == "current" for joint in robot.joints])
        torque = robot.compares_with_newton_metres & ~ampere
        if robot.effort.coupling is not None:
            torque &= ~((robot.effort.coupling != 0) @ ampere)
        limits = robot.limits
        torque &= np.isfinite(limits.torque) | ~current | ~np.isfinite(limits.current)
        self.bounds: Array = np.where(torque, limits.torque, np.where(current, limits.current, np.inf))
        units = ("N" if prismatic else "Nm" for prismatic in robot.prismatic)
        self.units = tuple(unit if there else "A" for unit, there in zip(units, torque, strict=True))
        self._robot, self._torque = robot, torque

    def of(self, reported: Array, q: Array) -> Array:
        """Return what is held against the bounds [n], of efforts as reported [n] at positions q [n] rad; nan: none."""
        torque = joint_torque(reported[None], q[None], self._robot)[0]
        return np.where(self._torque, torque, reported * self._robot.effort.drives(self._robot.joints))

    @property
    def unwatched(self) -> tuple[str, ...]:
        """A line for joints whose effort has nothing to be held against, with what would help."""
        lacking = ~np.isfinite(self.bounds)
        names: dict[str, list[str]] = {"A": [], "torque": []}
        for joint, unit, without in zip(self._robot.joints, self.units, lacking, strict=True):
            if without:
                names["A" if unit == "A" else "torque"].append(joint)
        ways = {
            "A": "it is a current of unknown Nm/A: give `current` [A], the largest of the drive, or `torque_constant`",
            "torque": "no torque limit is known: give `torque` [Nm]",
        }
        return tuple(
            f"the effort of {', '.join(joints)} is not watched, and rehearsals judge tracking alone there: {ways[kind]}"
            f" in the robot YAML, under joints: {joints[0]}"
            for kind, joints in names.items()
            if joints
        )


_EXACT = 1e-3  # of full speed


class SpeedScaling:
    """Keeps what was heard last: a motion is only itself at full speed. '' as topic: none is listened to."""

    def __init__(self, topic: str) -> None:
        """Nothing was heard yet."""
        self._topic = topic
        self._last: float | None = None
        self._percent = False

    def update(self, value: float) -> None:
        """Take in 1 or 100 for full speed; after more than 1 all is percent."""
        self._last = value
        self._percent = self._percent or value > 1.0 + _EXACT

    @property
    def problem(self) -> str:
        """Why the robot does not go at its full speed, as far as is known, or an empty text."""
        if not self._topic:
            return ""
        if self._last is None:
            return f"nothing was heard on {self._topic}"
        full = 100.0 if self._percent else 1.0
        return "" if abs(self._last - full) <= _EXACT * full else f"the robot's speed scaling is {self._last:g}"

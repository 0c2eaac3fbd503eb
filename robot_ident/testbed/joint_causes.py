"""What acts at the joints of a recorded arm besides its links: several causes on each, and a rest that has no name.

Torques along a known path at 1 kHz, coded apart from `robot_ident.effects` and from the plant's equations: friction
that memory shapes is made of bristles that slip one after the other, a ripple has overtones, a hose hardens.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from robot_ident.signals.motion import Array
from robot_ident.testbed.phenomena.phenomenon import between

Draw = Callable[["Course", int, np.random.Generator], "Torque"]
Torque = Callable[["Course", int], Array]

SIZES = (0.02, 0.08)
"""Rms torque of a cause, over the rms torque of the joint's random states."""
COUNTS = (2, 3)
"""Named causes of a joint that has any."""
REST = (0.05, 0.2)
"""Rms of the rest without a name, over the rms of a joint's named causes."""
ALONE = 0.005
"""Rms of the rest of a joint without named causes, over the rms torque of the joint's random states."""

_BRISTLES = np.array([0.12, 0.3, 0.6, 1.1, 2.0])  # reaches over their mean
_WAVES = 6  # of the rest


@dataclass(frozen=True)
class Course:
    """Where the joints are: q rad, dq rad/s, and the links' torque that the gears carry, Nm, each [N, n]; the motors'
    turns for each of a joint, [n], 1 where they are not known.
    """

    q: Array
    dq: Array
    load: Array
    ratio: Array


@dataclass(frozen=True)
class Cause:
    """One cause at one joint: its name in the catalogue, empty for the rest, and its torque [N] Nm along a course."""

    name: str
    joint: int
    size: float
    law: Torque

    def torque(self, course: Course) -> Array:
        """Return its torque [N]."""
        return self.size * self.law(course, self.joint)


def draw_causes(course: Course, size: Array, rng: np.random.Generator) -> list[Cause]:
    """Draw the causes of every joint, sized on a course; one joint has a rest alone. size [n]: rms torque, Nm."""
    n = course.q.shape[1]
    without, out = int(rng.integers(n)), []
    for joint in range(n):
        mine: list[Cause] = []
        chosen = rng.choice(list(_LAWS), int(rng.choice(COUNTS)), replace=False) if joint != without else ()
        total = np.zeros(len(course.q))
        late = [name for name in chosen if name in ("presliding", "friction_behind_play")]  # forms of one cause
        for name in (str(one) for one in chosen if one not in late[1:]):
            law = _LAWS[name](course, joint, rng)
            torque = law(course, joint)
            factor = between(rng, *SIZES) * size[joint] / _rms(torque)
            mine.append(Cause(name, joint, factor, law))
            total += factor * torque
        rest = rng.uniform(*REST) * _rms(total) if mine else ALONE * size[joint]
        law = _field(course, joint, rng)
        out += [*mine, Cause("", joint, rest / _rms(law(course, joint)), law)]
    return out


def _rms(x: Array) -> float:
    return float(np.sqrt(np.mean(x**2)))


def _speed(course: Course, joint: int) -> float:
    return float(np.abs(course.dq[:, joint]).max())


def _dragged(q: Array, free: float, reaches: Array) -> Array:
    """Return the mean force [N], 1 where all slide, of bristles that a joint drags through a clearance."""
    ends = free / 2.0 + reaches
    apart, out = np.zeros(len(reaches)), np.empty(len(q))
    for k, step in enumerate(np.diff(q, prepend=q[0])):
        apart = np.minimum(np.maximum(apart + step, -ends), ends)
        touched = np.sign(apart) * np.maximum(np.abs(apart) - free / 2.0, 0.0)
        out[k] = np.mean(touched / reaches)
    return out


def _presliding(course: Course, joint: int, rng: np.random.Generator) -> Torque:
    reach = between(rng, 0.001, 0.015)
    # less the sharp friction, which every model has
    return lambda x, j: _dragged(x.q[:, j], 0.0, reach * _BRISTLES) - np.sign(x.dq[:, j])


def _friction_behind_play(course: Course, joint: int, rng: np.random.Generator) -> Torque:
    gap = between(rng, 0.005, 0.05)
    reach = gap * between(rng, 0.02, 0.2)
    return lambda x, j: _dragged(x.q[:, j], gap, reach * _BRISTLES)


def _viscous_nonlinear(course: Course, joint: int, rng: np.random.Generator) -> Torque:
    bend = between(rng, 0.02, 0.2) * _speed(course, joint)
    return lambda x, j: np.arcsinh(x.dq[:, j] / bend)


def _viscous_asymmetric(course: Course, joint: int, rng: np.random.Generator) -> Torque:
    sign = float(rng.choice([-1.0, 1.0]))
    return lambda x, j: sign * np.abs(x.dq[:, j])


def _stribeck(course: Course, joint: int, rng: np.random.Generator) -> Torque:
    speed, exponent = between(rng, 0.03, 0.15) * _speed(course, joint), rng.uniform(0.6, 1.2)

    def law(x: Course, j: int) -> Array:
        v = x.dq[:, j]
        bent = np.exp(-np.minimum((np.abs(v) / speed) ** exponent, 300.0))
        return np.asarray(np.sign(v) * 2.0 * bent / (1.0 + bent**2))

    return law


def _load_friction(course: Course, joint: int, rng: np.random.Generator) -> Torque:
    rounded = 0.05 * _rms(course.load[:, joint])
    return lambda x, j: np.asarray(np.sign(x.dq[:, j]) * (np.hypot(x.load[:, j], rounded) - rounded))


def _position_friction(course: Course, joint: int, rng: np.random.Generator) -> Torque:
    at, times, narrow = rng.uniform(-np.pi, np.pi), float(rng.integers(1, 3)), rng.uniform(0.3, 1.0)
    return lambda x, j: np.sign(x.dq[:, j]) * np.exp(narrow * (np.cos(times * (x.q[:, j] - at)) - 1.0))


def _torque_ripple(course: Course, joint: int, rng: np.random.Generator) -> Torque:
    ratio = float(course.ratio[joint])
    least = 2.0 * np.pi * 4.0 / float(np.ptp(course.q[:, joint]))  # four cycles within the travel
    order = float(np.ceil(between(rng, least, 3.0 * least))) if ratio == 1.0 else ratio * float(rng.integers(1, 3))
    phase, overtone = rng.uniform(-np.pi, np.pi, 2)
    return lambda x, j: np.sin(order * x.q[:, j] + phase) + 0.2 * np.sin(2.0 * order * x.q[:, j] + overtone)


def _cable(course: Course, joint: int, rng: np.random.Generator) -> Torque:
    """Return a hose that hardens as it is bent away from a posture."""
    middle = float(np.median(course.q[:, joint])) + rng.uniform(-0.3, 0.3)
    return lambda x, j: np.asarray((x.q[:, j] - middle) * (1.0 + 0.1 * (x.q[:, j] - middle) ** 2))


def _field(course: Course, joint: int, rng: np.random.Generator) -> Torque:
    """Return a torque over positions of the joint and its neighbours and over its speed: waves of any direction."""
    n = course.q.shape[1]
    near = [k for k in (joint - 1, joint, joint + 1) if 0 <= k < n]
    waves, phases = rng.normal(0.0, 2.5, (_WAVES, len(near) + 1)), rng.uniform(-np.pi, np.pi, _WAVES)
    speed = max(_speed(course, joint), 1e-9)

    def law(x: Course, j: int) -> Array:
        at = np.column_stack([x.q[:, near], x.dq[:, j] / speed])
        return np.asarray(np.cos(at @ waves.T + phases).sum(axis=1))

    return law


_LAWS: Mapping[str, Draw] = {
    "presliding": _presliding,
    "friction_behind_play": _friction_behind_play,
    "viscous_nonlinear": _viscous_nonlinear,
    "viscous_asymmetric": _viscous_asymmetric,
    "stribeck": _stribeck,
    "load_friction": _load_friction,
    "position_friction": _position_friction,
    "torque_ripple": _torque_ripple,
    "cable": _cable,
}

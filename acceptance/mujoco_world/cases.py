"""Cases of the MuJoCo world: which arm, what is hidden, where, how large, and the recordings that show it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from mujoco_world.arm import DECIMATE, STEP, Arm, Array, Motion, Plan, Servo, left_over, play
from mujoco_world.effects import KNOWN, OF_ROBOT, UNKNOWN, Build, Draw, joints_of

LARGEST, SMALLEST = 0.5, 0.06
"""Rms that a hidden effect leaves on the joint that shows it most, in standard deviations of a sample of its effort."""
POSSIBLE = (0.1, 10.0)
RANGE = {
    "joint_elasticity": (0.15, 1.5),  # 33 to 3.3 kNm/rad
    "backlash": (0.2, 3.0),  # mrad
    "time_delay": (0.6, 4.0),  # 3 to 20 ms
    "presliding": (0.1, 3.0),  # 1 to 30 mrad
    "stribeck": (0.1, 2.0),  # 5 to 100 % of the dry friction
    "position_friction": (0.1, 2.0),  # the same, half of it over a turn
    "friction_behind_play": (0.05, 2.0),  # the same, behind 5 to 50 mrad
    "torque_ripple": (0.1, 2.0),  # Nm
}
"""Of the usual size: what an arm may have."""
PERIODS = 10


@dataclass(frozen=True)
class MujocoCase:
    """truth: `name@joint` of what the catalogue knows; what: all that is hidden, with sizes; visible [n] Nm rms.

    recordings: t [N], q, tau [N, n] of each motion, the last one without noise.
    """

    truth: tuple[str, ...]
    what: tuple[str, ...]
    visible: Array
    recordings: tuple[tuple[Array, Array, Array], ...]


@dataclass(frozen=True)
class _Hidden:
    label: str
    joint: int
    build: Build
    size: float


def make_case(seed: int, kind: str, arm: Arm, motions: Sequence[Motion], *, periods: int = PERIODS) -> MujocoCase:
    """Return a case of a kind; the last motion is unseen by any fit: one steady period, without noise."""
    rng = np.random.default_rng([seed, *kind.encode()])
    servo = Servo.draw(rng)
    plans = [Plan.of(arm, servo, motion) for motion in motions]
    count = {"single": 1, "pair": 2, "unknown": 1, "null": 0}[kind]
    hidden: list[_Hidden] = []
    while len(hidden) < count:
        one = _drawn(rng, arm, plans[:-1], unknown=kind == "unknown")
        if not any(one.label == other.label or _same_gear(one, other) for other in hidden):
            hidden.append(one)
    put = [partial(one.build, size=one.size) for one in hidden]
    left = np.zeros(len(arm.joints))
    if hidden:
        left = left_over(arm, [play(arm, put, plan, 1) for plan in plans[:-1]])
    recordings = []
    for number, plan in enumerate(plans):
        last = number == len(plans) - 1
        q, tau = play(arm, put, plan, 2 if last else periods)
        if not last:
            q = q + rng.normal(0.0, arm.position_noise, q.shape)
            tau = tau + rng.normal(0.0, 1.0, tau.shape) * arm.torque_noise
        recordings.append((np.arange(len(q)) * STEP * DECIMATE, q, tau))
    truth = () if kind == "unknown" else tuple(one.label for one in hidden)
    return MujocoCase(truth, tuple(f"{one.label} x {one.size:.3g}" for one in hidden), left, tuple(recordings))


def _same_gear(one: _Hidden, other: _Hidden) -> bool:
    """Return whether both replace the same element of the same joint."""
    names = {one.label.partition("@")[0], other.label.partition("@")[0]}
    exclusive = ({"stribeck", "presliding"}, {"joint_elasticity", "backlash"})
    return one.joint == other.joint and any(names <= pair for pair in exclusive)


def _drawn(rng: np.random.Generator, arm: Arm, plans: Sequence[Plan], *, unknown: bool) -> _Hidden:
    reach = np.array([[min(p.motion.q[:, j].min() for p in plans), max(p.motion.q[:, j].max() for p in plans)]
                      for j in range(len(arm.joints))])  # fmt: skip
    while True:
        name = str(rng.choice(list(UNKNOWN if unknown else KNOWN)))
        joint = int(rng.choice(joints_of(name, arm)))
        build = (UNKNOWN if unknown else KNOWN)[name](Draw(rng, arm, joint, reach))
        target = float(np.exp(rng.uniform(np.log(SMALLEST), np.log(LARGEST))))
        found = _sized(arm, build, plans[:2], target, RANGE.get(name, POSSIBLE))
        if found is not None:
            whole = name in OF_ROBOT or unknown
            return _Hidden(name if whole else f"{name}@{arm.joints[joint]}", joint, build, found)


def _sized(arm: Arm, build: Build, plans: Sequence[Plan], target: float, possible: tuple[float, float]) -> float | None:
    """Return the size at which an effect leaves about the target, None where no possible size does."""
    size = float(np.clip(1.0, *possible))
    for _ in range(8):
        try:
            left = left_over(arm, [play(arm, [partial(build, size=size)], plan, 1) for plan in plans])
        except ArithmeticError:
            return None
        ratio = target / max(float((left / arm.torque_noise).max()), 1e-9)
        if abs(np.log(ratio)) < 0.15:
            return size
        size *= float(np.clip(ratio, 0.2, 5.0))
        if not possible[0] < size < possible[1]:
            return None
    return None

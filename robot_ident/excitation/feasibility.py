"""Whether a robot's limits are there and can be met together, and poses that meet them."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from robot_ident.errors import InputError
from robot_ident.motion import Array
from robot_ident.robot.robot import Robot

_TOGETHER = "limits that can't be met together: the position limits and"


def require_limits(robot: Robot) -> None:
    """Raise InputError that names the joints which lack a limit of position, velocity or acceleration; none is
    invented.
    """
    limits = robot.limits
    given = {
        "position": np.isfinite(limits.lower) & np.isfinite(limits.upper),
        "velocity": np.isfinite(limits.velocity),
        "acceleration": np.isfinite(limits.acceleration),
    }
    lacking = {
        name: [joint for joint, known in zip(robot.joints, there, strict=True) if not known]
        for name, there in given.items()
    }
    words = [f"no {name} limit for {', '.join(joints)}" for name, joints in lacking.items() if joints]
    if words:
        first = next(name for name, joints in lacking.items() if joints)
        raise InputError(f"{robot.source}: {'; '.join(words)}: give {first}: under joints in a robot YAML")


def rule_margins(robot: Robot, q: Array) -> Array:
    """Return the margin [N, rules] m of every rule of the workspace at positions q [N, n]."""
    places = {rule.frame: robot.rigid.frame_position(q, rule.frame) for rule in robot.workspace}
    return np.array([rule.margin(places[rule.frame]) for rule in robot.workspace]).reshape(-1, len(q)).T


def allowed_poses(robot: Robot, count: int = 100, spread: float = 0.6, seed: int = 0) -> Array:
    """Return random poses [count, n] that keep every rule, inside `spread` of the position limits where there are such.

    Raises InputError that says which limits can't be met together when no pose keeps them.
    """
    rng, limits = np.random.default_rng(seed), robot.limits
    middle, half = 0.5 * (limits.upper + limits.lower), 0.5 * (limits.upper - limits.lower)
    found = np.zeros((0, robot.n))
    for width in (spread, spread, spread, 0.98, 0.98):
        q = middle + width * half * rng.uniform(-1.0, 1.0, (4 * count, robot.n))
        kept = np.all(rule_margins(robot, q) > 0.0, axis=1)
        found = np.concatenate([found, q[kept]])
        if len(found) >= count:
            return found[:count]
    if not len(found):
        found = _climb(robot, range(len(robot.workspace)), rng)[None, :]
        if not np.all(rule_margins(robot, found) > 0.0):
            raise InputError(f"{robot.source}: {_conflict(robot, rng)}")
    return found[np.arange(count) % len(found)]


def _climb(robot: Robot, rules: range | tuple[int, ...], rng: np.random.Generator) -> Array:
    """Return the pose [n] with about the largest smallest margin of some rules, by random search that narrows."""
    limits = robot.limits
    best, width = 0.5 * (limits.upper + limits.lower), 0.98 * (limits.upper - limits.lower)
    for _ in range(12):
        q = np.clip(best + width * rng.uniform(-1.0, 1.0, (500, robot.n)), limits.lower, limits.upper)
        q = np.concatenate([best[None, :], q])
        best = q[np.argmax(rule_margins(robot, q)[:, list(rules)].min(axis=1))]
        width = 0.6 * width
    return np.asarray(best)


def _conflict(robot: Robot, rng: np.random.Generator) -> str:
    """Return in words the smallest set of rules that no pose within the position limits keeps."""
    every = range(len(robot.workspace))
    for size in range(1, len(robot.workspace) + 1):
        for some in combinations(every, size):
            margin = rule_margins(robot, _climb(robot, some, rng)[None, :])[0, list(some)].min()
            if margin <= 0.0:
                words = " and ".join(f"'{robot.workspace[k].text}'" for k in some)
                return f"{_TOGETHER} {words} (short by {-margin:.3g} m at best)"
    return f"{_TOGETHER} the rules of the workspace"

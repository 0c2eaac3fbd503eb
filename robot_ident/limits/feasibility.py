"""Whether a robot's limits are there and can be met together, and poses that meet them."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import combinations

import numpy as np

from robot_ident.errors import InputError
from robot_ident.limits.self_collision import LinkPairs, link_pairs
from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Array, Motion

_TOGETHER = "limits that can't be met together: the position limits and"


def require_limits(robot: Robot) -> None:
    """Raise InputError that names the joints which lack a limit of position, velocity or acceleration."""
    lacking = joints_without_limit(robot)
    lacking.pop("torque", None)
    if lacking:
        words = "; ".join(f"no {name} limit for {', '.join(joints)}" for name, joints in lacking.items())
        raise InputError(f"{robot.source}: {words}: give {next(iter(lacking))}: under joints in a robot YAML")
    for joint, lower, upper in zip(robot.joints, robot.limits.lower, robot.limits.upper, strict=True):
        if not lower < upper:
            raise InputError(
                f"{robot.source}: joint {joint!r}: its lower position limit {lower:g} is not below its upper {upper:g}"
            )


def joints_without_limit(robot: Robot) -> dict[str, list[str]]:
    """Return the joints that lack a limit, by its name: position, velocity, acceleration, torque; those with any."""
    limits = robot.limits
    given = {
        "position": np.isfinite(limits.lower) & np.isfinite(limits.upper),
        "velocity": np.isfinite(limits.velocity),
        "acceleration": np.isfinite(limits.acceleration),
        "torque": np.isfinite(limits.torque),
    }
    return {name: [robot.joints[j] for j in np.flatnonzero(~there)] for name, there in given.items() if not there.all()}


def overloaded(robot: Robot, count: int = 400) -> str:
    """Return in words at which joints the arm's own weight exceeds the torque limit at every one of many allowed poses,
    |g(q)| > tau_max; nothing where a pose can be held.
    """
    q = allowed_poses(robot, count, spread=0.98)
    zero = np.zeros_like(q)
    least = np.abs(robot.rigid.inverse_dynamics(Motion(q, zero, zero))).min(axis=0)
    words = [
        f"{joint} takes {torque:.3g} {robot.link_torque_unit(k)} at least against gravity, its limit is {limit:g}"
        for k, (joint, torque, limit) in enumerate(zip(robot.joints, least, robot.limits.torque, strict=True))
        if torque > limit
    ]
    return "; ".join(words)


def rule_margins(robot: Robot, q: Array) -> Array:
    """Return the margin [N, rules] m of every rule of the workspace at positions q [N, n]."""
    places = {rule.frame: robot.rigid.frame_position(q, rule.frame) for rule in robot.workspace}
    return np.array([rule.margin(places[rule.frame]) for rule in robot.workspace]).reshape(-1, len(q)).T


class PoseLimits:
    """What a pose within the position limits has to keep: the rules of the workspace and the clearance of the links."""

    def __init__(self, robot: Robot, links: LinkPairs | None = None) -> None:
        """Take a robot, and its pairs of links where they are at hand; InputError where its geometry can't be read."""
        self._robot, self._links = robot, links or link_pairs(robot)[0]
        self._clearance = robot.geometry.clearance if robot.geometry is not None else 0.0
        if self._links is not None and not self._links.count:
            self._links = None

    @property
    def count(self) -> int:
        """Number of limits: one a rule, and one for the links where they are looked at."""
        return len(self._robot.workspace) + (self._links is not None)

    def margins(self, q: Array) -> Array:
        """Return the margin [N, count] m of every limit at positions q [N, n]."""
        rules = rule_margins(self._robot, q)
        if self._links is None:
            return rules
        apart = np.array([self._links.closest(pose)[0] for pose in q]) - self._clearance
        return np.hstack([rules, apart[:, None]])

    def text(self, limit: int, q: Array) -> str:
        """Return a limit in words; of the links the pair that comes nearest at pose q [n]."""
        if limit < len(self._robot.workspace):
            return f"the rule '{self._robot.workspace[limit].text}'"
        assert self._links is not None
        pair = self._links.name(self._links.closest(q)[1])
        return f"the clearance of {self._clearance:g} m between links ({pair})"


def allowed_poses(robot: Robot, count: int = 100, spread: float = 0.6, seed: int = 0) -> Array:
    """Return random poses [count, n] that keep every rule and the clearance of the links, inside `spread` of the
    position limits where there are such.

    Raises InputError that says which limits can't be met together when no pose keeps them.
    """
    rng, limits, poses = np.random.default_rng(seed), robot.limits, PoseLimits(robot)
    middle, half = 0.5 * (limits.upper + limits.lower), 0.5 * (limits.upper - limits.lower)
    found = np.zeros((0, robot.n))
    for width in (spread, spread, spread, 0.98, 0.98):
        q = middle + width * half * rng.uniform(-1.0, 1.0, (4 * count, robot.n))
        kept = np.all(poses.margins(q) > 0.0, axis=1)
        found = np.concatenate([found, q[kept]])
        if len(found) >= count:
            return found[:count]
    if not len(found):
        found = _climb(robot, poses, range(poses.count), rng)[None, :]
        if not np.all(poses.margins(found) > 0.0):
            raise InputError(f"{robot.source}: {_conflict(robot, poses, rng)}")
    return found[np.arange(count) % len(found)]


def _climb(robot: Robot, poses: PoseLimits, which: Iterable[int], rng: np.random.Generator) -> Array:
    """Return the pose [n] with about the largest smallest margin of some limits, by random search that narrows."""
    limits = robot.limits
    best, width = 0.5 * (limits.upper + limits.lower), 0.98 * (limits.upper - limits.lower)
    for _ in range(12):
        q = np.clip(best + width * rng.uniform(-1.0, 1.0, (500, robot.n)), limits.lower, limits.upper)
        q = np.concatenate([best[None, :], q])
        best = q[np.argmax(poses.margins(q)[:, list(which)].min(axis=1))]
        width = 0.6 * width
    return np.asarray(best)


def _conflict(robot: Robot, poses: PoseLimits, rng: np.random.Generator) -> str:
    """Return in words the smallest set of limits that no pose within the position limits keeps."""
    for size in range(1, poses.count + 1):
        for some in combinations(range(poses.count), size):
            best = _climb(robot, poses, some, rng)
            margin = poses.margins(best[None, :])[0, list(some)].min()
            if margin <= 0.0:
                words = " and ".join(poses.text(k, best) for k in some)
                return f"{_TOGETHER} {words} (short by {-margin:.3g} m at best)"
    return f"{_TOGETHER} the rules of the workspace"

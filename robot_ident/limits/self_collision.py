"""Certified distance between the links of a moving robot.

The distance of two convex bodies changes no faster than sum_k r_k |dq_k| over the joints k between them, where r_k is
the largest distance of either body's points from joint k's origin: the gradient is n . (z_k x (p - o_k)) with p the
nearest point of either body. So over an interval of half width h about t
d(t + s) >= d(t) - h sum_k r_k max |dq_k|: a proven lower bound.

Capsules about bodies: a quick lower bound of the distance between them, for many poses at once.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from robot_ident.robot.geometry import Body, MeshMissing, Shapes
from robot_ident.robot.robot import Robot
from robot_ident.robot.symbolic import placements_function
from robot_ident.signals.motion import Array
from robot_ident.trajectories.excitation import Piece
from robot_ident.trajectories.extremes import halved, intervals


class Capsule(NamedTuple):
    """All points within `radius` [m] of the segment between two points [2, 3] m."""

    ends: Array
    radius: float


def capsule_about(points: Array, swell: float) -> Capsule:
    """Return a capsule that holds all points [V, 3] m and what is within `swell` [m] of them: along their longest
    principal axis, shortened by the radius at its ends.
    """
    middle = 0.5 * (points.max(axis=0) + points.min(axis=0))
    away = points - middle
    axis = np.linalg.svd(away, full_matrices=False)[2][0] if len(points) > 1 else np.array([1.0, 0.0, 0.0])
    along = away @ axis
    across = away - np.outer(along, axis)
    middle = middle + 0.5 * (across.max(axis=0) + across.min(axis=0))
    girth = float(np.linalg.norm(points - middle - np.outer(along, axis), axis=1).max())
    low, high = float(along.min()) + girth, float(along.max()) - girth
    if low > high:
        low = high = 0.5 * (low + high)
    ends = middle + np.outer([low, high], axis)
    return Capsule(ends, float(point_segment_distance(points, ends).max()) + swell)


def point_segment_distance(points: Array, ends: Array) -> Array:
    """Return the distances [V] of points [V, 3] from a segment [2, 3]."""
    direction = ends[1] - ends[0]
    size = float(direction @ direction)
    share = np.clip((points - ends[0]) @ direction / size, 0.0, 1.0) if size > 0 else np.zeros(len(points))
    return np.asarray(np.linalg.norm(points - ends[0] - np.outer(share, direction), axis=1))


def segment_distance(a: Array, b: Array) -> Array:
    """Return the distances [...] of segments a from b [..., 2, 3] (Ericson, Real-Time Collision Detection, 5.1.9)."""
    u, v, w = a[..., 1, :] - a[..., 0, :], b[..., 1, :] - b[..., 0, :], a[..., 0, :] - b[..., 0, :]
    uu, vv, uv, uw, vw = (np.einsum("...i,...i", x, y) for x, y in ((u, u), (v, v), (u, v), (u, w), (v, w)))
    tiny = 1e-18
    slope = uu * vv - uv * uv
    s = np.where(slope > 1e-12 * uu * vv + tiny, np.clip((uv * vw - uw * vv) / np.maximum(slope, tiny), 0.0, 1.0), 0.0)
    t = (uv * s + vw) / np.maximum(vv, tiny)
    clipped = np.clip(t, 0.0, 1.0)
    again = np.clip((uv * clipped - uw) / np.maximum(uu, tiny), 0.0, 1.0)
    s = np.where((clipped != t) | (vv <= tiny), again, s)
    apart = w + s[..., None] * u - clipped[..., None] * v
    return np.asarray(np.sqrt(np.einsum("...i,...i", apart, apart)))


TOLERANCE = 1e-4  # m, of the certified margin
_SOLVER = 1e-5  # m by which a computed distance may be wrong: ten times the tolerance of coal's GJK
_FIRST = 32  # intervals
_BUDGET = 300_000  # pairs and intervals


class Separation(NamedTuple):
    """A proven lower bound [m] of the distance, the smallest distance found, its time [s] and its pair of bodies."""

    lower: float
    value: float
    time: float
    pair: int


class LinkPairs:
    """The pairs of a robot's bodies that must not touch: distances and their rates."""

    def __init__(self, robot: Robot, shapes: Shapes) -> None:
        """Prepare capsules and reaches; nothing of `shapes` is changed."""
        self.robot, self.shapes = robot, shapes
        self._data, self._found = shapes.model.createData(), shapes.geometry.createData()
        self._first, self._second = (np.array([pair[k] for pair in shapes.pairs], dtype=int) for k in (0, 1))

    def prepare(self) -> None:
        """Make now what is made when it is first needed."""
        if self.count:
            _ = self._capsules, self._placements

    @property
    def count(self) -> int:
        """Number of pairs."""
        return len(self.shapes.pairs)

    def name(self, pair: int) -> str:
        """Return the names of a pair's links."""
        a, b = (self.shapes.bodies[body].link for body in self.shapes.pairs[pair])
        return f"{a} and {b}"

    @cached_property
    def _capsules(self) -> tuple[Array, Array]:
        made = [capsule_about(body.points, body.swell) for body in self.shapes.bodies]
        return np.array([capsule.ends for capsule in made]), np.array([capsule.radius for capsule in made])

    @cached_property
    def _placements(self) -> Any:
        return placements_function(self.robot)

    def bound(self, q: Array) -> Array:
        """Return lower bounds [N, P] m of the distances at positions q [N, n], from capsules about the bodies."""
        n = self.robot.n
        rotations, positions = (np.array(part) for part in self._placements(q.T))
        r = np.concatenate([np.tile(np.eye(3), (len(q), 1, 1, 1)), rotations.T.reshape(-1, n, 3, 3)], axis=1)
        p = np.concatenate([np.zeros((len(q), 1, 3)), positions.T.reshape(-1, n, 3)], axis=1)
        ends, radii = self._capsules
        joints = [body.joint for body in self.shapes.bodies]
        # a column of the rotations is a row here: x_base = R x, with R stored by columns
        placed = np.einsum("bek,mbki->mbei", ends, r[:, joints]) + p[:, joints][:, :, None, :]
        apart = segment_distance(placed[:, self._first], placed[:, self._second])
        return apart - (radii[self._first] + radii[self._second])

    def distances(self, q: Array, pairs: Any) -> Array:
        """Return the distances [K] m of some pairs [K] at one pose q [n]; negative where they overlap."""
        import pinocchio

        geometry, found = self.shapes.geometry, self._found
        pinocchio.updateGeometryPlacements(self.shapes.model, self._data, geometry, found, q)
        return np.array([pinocchio.computeDistance(geometry, found, int(pair)).min_distance for pair in pairs])

    def closest(self, q: Array) -> tuple[float, int]:
        """Return the smallest distance [m] at one pose q [n], negative where links overlap, and its pair."""
        bound = self.bound(q[None, :])[0]
        order = np.argsort(bound)
        best, pair, tried = np.inf, 0, 0
        while tried < len(order) and bound[order[tried]] < best:
            some = order[tried : tried + 4]
            found = self.distances(q, some)
            if found.min() < best:
                best, pair = float(found.min()), int(some[np.argmin(found)])
            tried += len(some)
        return best, pair

    def gradients(self, pairs: Any) -> Array:
        """Return d distance / dq [K, n] of pairs whose distances were computed last, at that pose."""
        results = [self._found.distanceResults[int(pair)] for pair in pairs]
        normals = np.array([np.array(result.normal).ravel() for result in results])
        points = np.array([np.array(result.getNearestPoint2()).ravel() for result in results])
        frames = [self._data.oMi[1 + joint] for joint in range(self.robot.n)]
        origins = np.array([frame.translation for frame in frames])
        axes = np.einsum("jik,jk->ji", np.array([frame.rotation for frame in frames]), self._axes)
        moments = np.cross(points[:, None, :] - origins, normals[:, None, :])  # n . (z x r) = z . (r x n)
        turning = np.einsum("ji,kji->kj", axes, moments)
        slopes = np.where(self.robot.prismatic, normals @ axes.T, turning)
        return np.where(self._between[pairs], slopes, 0.0)

    @cached_property
    def _between(self) -> Any:
        """Which joints [P, n] lie between the bodies of each pair."""
        bodies, joints = self.shapes.bodies, np.arange(self.robot.n)
        ends = np.array([(bodies[i].joint, bodies[j].joint) for i, j in self.shapes.pairs])
        return (joints >= ends[:, :1]) & (joints < ends[:, 1:])

    @cached_property
    def _axes(self) -> Array:
        from robot_ident.robot.symbolic import joint_axis

        parts = [joint_axis(self.robot, joint) for joint in range(self.robot.n)]
        return np.array([linear + angular for linear, angular in parts])

    def reaches(self, travel: Array) -> Array:
        """Return bounds [P, n] of |d distance / dq_k|, m/rad or 1; travel [n]: largest |q| of the prismatic joints."""
        out = np.zeros((self.count, self.robot.n))
        for pair, (i, j) in enumerate(self.shapes.pairs):
            a, b = self.shapes.bodies[i], self.shapes.bodies[j]
            out[pair, a.joint : b.joint] = np.minimum(self._inward(a, b, travel), self._outward(a, b, travel))
        sliding = np.array(self.robot.prismatic)
        out[:, sliding] = np.minimum(out[:, sliding], 1.0)
        return out

    def _links(self, travel: Array) -> Array:
        """Return bounds [n] m of the distance between the origins of each joint's frame and the one before."""
        model = self.shapes.model
        lengths = [float(np.linalg.norm(model.jointPlacements[1 + k].translation)) for k in range(self.robot.n)]
        return np.array(lengths) + np.where(self.robot.prismatic, travel, 0.0)

    def _inward(self, a: Body, b: Body, travel: Array) -> Array:
        """Return the largest distance of b's points from each joint's origin, from the joint after a to that of b."""
        first = float(np.linalg.norm(b.points, axis=1).max()) + b.swell
        return np.cumsum([first, *self._links(travel)[a.joint + 1 : b.joint][::-1]])[::-1]

    def _outward(self, a: Body, b: Body, travel: Array) -> Array:
        """Return the largest distance of a's points from each joint's origin, from the joint after a to that of b."""
        origin = np.array(self.shapes.model.jointPlacements[1 + a.joint].translation)
        slide = float(travel[a.joint]) if self.robot.prismatic[a.joint] else 0.0
        first = float(np.linalg.norm(a.points - origin, axis=1).max()) + a.swell + slide
        return np.cumsum([first, *self._links(travel)[a.joint + 1 : b.joint]])


def link_pairs(robot: Robot) -> tuple[LinkPairs | None, list[str]]:
    """Return the pairs of links that must not touch, or None with the reason why they can't be looked at (no reason:
    there are none). Raises InputError where the robot's owner asks for them and a mesh is missing.
    """
    if robot.geometry is None:
        return None, []
    try:
        return LinkPairs(robot, robot.geometry.shapes), []
    except MeshMissing as error:
        if robot.geometry.asked:
            raise
        return None, [f"self-collision ({error})"]


def self_separation(pairs: LinkPairs, piece: Piece, tolerance: float = TOLERANCE) -> Separation:
    """Return the certified smallest distance between the links along a piece of a motion."""
    search = _Search(pairs, piece)
    found = search.minimum(tolerance)
    clearance = _clearance(pairs)
    if found.value > clearance >= found.lower:  # kept by less than the tolerance
        found = search.minimum(max(0.5 * (found.value - clearance - _SOLVER), 1e-9))
    return found


def keeps_apart(pairs: LinkPairs, piece: Piece) -> bool:
    """Return whether the links are proven to stay apart by more than the clearance along a piece of a motion."""
    return _Search(pairs, piece).stays_above(_clearance(pairs))


def _clearance(pairs: LinkPairs) -> float:
    return pairs.robot.geometry.clearance if pairs.robot.geometry is not None else 0.0


class _Search:
    """Halves intervals, pair by pair, until a lower bound holds on every one."""

    def __init__(self, pairs: LinkPairs, piece: Piece) -> None:
        self._pairs, self._piece = pairs, piece
        extremes = piece.extremes
        self._reach = pairs.reaches(extremes.q.largest)
        self._top, self._acceleration = extremes.dq.largest, extremes.ddq.largest

    def minimum(self, tolerance: float) -> Separation:
        """Return the smallest distance to within a tolerance; wider, but proven, where the budget is spent."""
        best, lowest = Separation(np.inf, np.inf, self._piece.start, 0), np.inf
        times, halves, pairs = self._first()
        spent = 0
        while len(times):
            quick, drop = self._quick(times, halves, pairs)
            spent += len(times)
            if spent > _BUDGET:
                lowest = float(np.min(quick - drop))
                break
            for k in _by_pose(times, np.argsort(quick)):
                k = k[quick[k] - drop[k] < best.value - tolerance]
                if len(k):
                    quick[k] = self._exact(times[k[0]], pairs[k])
                    near = int(k[np.argmin(quick[k])])
                    if quick[near] < best.value:
                        best = Separation(0.0, float(quick[near]), float(times[near]), int(pairs[near]))
            open_ = quick - drop < best.value - tolerance
            (times, halves), pairs = halved(times, halves, open_), np.repeat(pairs[open_], 2)
        return best._replace(lower=min(best.value - tolerance - _SOLVER, lowest - _SOLVER))

    def stays_above(self, clearance: float) -> bool:
        """Return whether every distance is proven to be above the clearance."""
        times, halves, pairs = self._first()
        spent = 0
        while len(times):
            quick, drop = self._quick(times, halves, pairs)
            spent += len(times)
            if spent > _BUDGET:
                return False
            for k in _by_pose(times, np.flatnonzero(quick - drop <= clearance)):
                quick[k] = self._exact(times[k[0]], pairs[k]) - _SOLVER
                if np.any(quick[k] <= clearance):
                    return False
            open_ = quick - drop <= clearance
            (times, halves), pairs = halved(times, halves, open_), np.repeat(pairs[open_], 2)
        return True

    def _first(self) -> tuple[Array, Array, Array]:
        count, piece = self._pairs.count, self._piece
        centres, halves = intervals(piece.start, piece.end, _FIRST)
        return np.repeat(centres, count), np.repeat(halves, count), np.tile(np.arange(count), _FIRST)

    def _quick(self, times: Array, halves: Array, pairs: Array) -> tuple[Array, Array]:
        """Return the capsules' distances [K] and how much the bodies may come nearer within the intervals [K] m."""
        instants, place = np.unique(times, return_inverse=True)
        motion = self._piece.motion(instants)
        speed = np.minimum(np.abs(motion.dq)[place] + halves[:, None] * self._acceleration, self._top)
        return self._pairs.bound(motion.q)[place, pairs], halves * np.einsum("kj,kj->k", speed, self._reach[pairs])

    def _exact(self, time: float, pairs: Array) -> Array:
        return self._pairs.distances(self._piece.motion(np.array([time])).q[0], pairs)


def _by_pose(times: Array, rows: Any) -> list[Array]:
    """Return groups of rows with the same time, in the order in which the times first appear."""
    if not len(rows):
        return []
    _, first, place = np.unique(times[rows], return_index=True, return_inverse=True)
    order = np.argsort(first[place], kind="stable")
    ends = np.flatnonzero(np.diff(first[place][order])) + 1
    return [np.asarray(group) for group in np.split(rows[order], ends)]

"""The bodies of a robot's links: meshes, convex pieces, and which of them may touch."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields
from functools import cache, cached_property, lru_cache
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from robot_ident.errors import InputError, did_you_mean
from robot_ident.files import read_text, refuse_special
from robot_ident.robot.urdf import find_resource, lock, lock_geometry, parse_urdf, prepared, quiet
from robot_ident.signals.motion import Array

_PIECES = 4  # most pieces of one mesh
_GAIN = 0.06  # share of the hull's volume that a cut must save
_CUTS = (0.2, 0.4, 0.6, 0.8)  # where planes are tried, as shares of the extent
_DIRECTIONS = 100  # whose farthest points tell about how large a hull is


class _Part:
    """What a slab of space holds of a surface.

    triangles [T, 3, 3] m; points [V, 3] m: their corners, each once; edges [E, 2]: the points that they join.
    """

    def __init__(self, triangles: Array) -> None:
        """Number the corners. ValueError for a surface without a volume."""
        self.triangles = triangles
        self.points, numbers = _each_once(triangles.reshape(-1, 3).round(9))
        ends = numbers.reshape(-1, 3)[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
        pairs = np.unique(ends.min(axis=1) * len(self.points) + ends.max(axis=1))
        self.edges = np.stack(np.divmod(pairs, len(self.points)), axis=1)
        self.volume = float(_hull(self.points).volume)

    @cached_property
    def cut(self) -> tuple[_Part, _Part] | None:
        """The two parts of about the least volume into which a plane cuts this one; None where it is nearly convex."""
        if _inside(self.triangles) > (1.0 - _GAIN) * self.volume:
            return None
        low, high = self.points.min(axis=0), self.points.max(axis=0)
        best: tuple[float, int, float] | None = None
        for axis in range(3):
            for share in _CUTS:
                level = float(low[axis] + share * (high[axis] - low[axis]))
                try:
                    volume = sum(_about(points) for points in self._sides(axis, level))
                except ValueError:  # one side is flat or empty
                    continue
                if best is None or volume < best[0]:
                    best = volume, axis, level
        if best is None:
            return None
        first, second = (_Part(_clipped(self.triangles, *best[1:], sign)) for sign in (1.0, -1.0))
        return first, second

    @property
    def saved(self) -> float:
        """Volume that the cut saves [m^3]."""
        return 0.0 if self.cut is None else self.volume - self.cut[0].volume - self.cut[1].volume

    def _sides(self, axis: int, level: float) -> tuple[Array, Array]:
        """Return points [V, 3] whose hull is that of the surface above a plane, and of the surface below."""
        height = self.points[:, axis] - level
        crossing = self.edges[height[self.edges[:, 0]] * height[self.edges[:, 1]] < 0.0]
        (p, q), (a, b) = self.points[crossing.T], height[crossing.T]
        on = p + (a / (a - b))[:, None] * (q - p)
        return np.concatenate([self.points[height >= 0.0], on]), np.concatenate([self.points[height <= 0.0], on])


def convex_pieces(triangles: Array) -> list[Array]:
    """Return points [V, 3] of convex pieces whose union holds the closed surface of triangles [T, 3, 3] and its inside.

    The surface is cut by planes across its axes, where that saves most of the hulls' volume. What a slab of space holds
    of the solid lies within the hull of what it holds of the surface, so nothing is lost. Raises ValueError for a flat
    or an empty surface.
    """
    whole = _Part(triangles)
    parts = [whole]
    while len(parts) < _PIECES:
        index = int(np.argmax([part.saved for part in parts]))
        cut = parts[index].cut
        if cut is None or parts[index].saved < _GAIN * whole.volume:
            break
        parts[index : index + 1] = cut
    return [part.points[_hull(part.points).vertices] for part in parts]


def _each_once(points: Array) -> tuple[Array, Array]:
    """Return points [N, 3] without repetition, and the number of each in what is left [N]."""
    order = np.lexsort(points.T)
    new = np.ones(len(points), dtype=bool)
    new[1:] = np.any(points[order][1:] != points[order][:-1], axis=1)
    numbers = np.empty(len(points), dtype=int)
    numbers[order] = np.cumsum(new) - 1
    return points[order][new], numbers


def _inside(triangles: Array) -> float:
    """Return the volume inside a closed surface [m^3], by the divergence theorem."""
    a, b, c = (triangles[:, k] - triangles.mean(axis=(0, 1)) for k in range(3))
    return abs(float(np.einsum("ki,ki->", a, np.cross(b, c)))) / 6.0


def _clipped(triangles: Array, axis: int, level: float, sign: float) -> Array:
    """Return the triangles' parts with sign * (x_axis - level) >= 0, as triangles again."""
    height = sign * (triangles[:, :, axis] - level)
    kept = [triangles[np.all(height >= 0.0, axis=1)]]
    across = (height.min(axis=1) < 0.0) & (height.max(axis=1) > 0.0)
    for corners, heights in zip(triangles[across], height[across], strict=True):
        polygon = []
        for k in range(3):
            a, b, p, q = heights[k], heights[k - 2], corners[k], corners[k - 2]
            if a >= 0.0:
                polygon.append(p)
            if a * b < 0.0:
                polygon.append(p + a / (a - b) * (q - p))
        kept.append(np.array([[polygon[0], polygon[k], polygon[k + 1]] for k in range(1, len(polygon) - 1)]))
    return np.concatenate([some.reshape(-1, 3, 3) for some in kept])


def _about(points: Array) -> float:
    """Return the volume of the hull of those of points [V, 3] that lie farthest along many directions [m^3]."""
    if not len(points):
        raise ValueError("a surface without a volume")
    return float(_hull(points[np.unique((points @ _directions()).argmax(axis=0))]).volume)


@cache
def _directions() -> Array:
    """Return unit vectors [3, D] spread evenly over the sphere, on a spiral of the golden angle."""
    z = np.linspace(-1.0, 1.0, _DIRECTIONS)
    angle = np.pi * (3.0 - np.sqrt(5.0)) * np.arange(_DIRECTIONS)
    return np.stack([np.sqrt(1.0 - z**2) * np.cos(angle), np.sqrt(1.0 - z**2) * np.sin(angle), z])


def _hull(points: Array) -> Any:
    """Return SciPy's convex hull of points [V, 3]; ValueError where it has no volume."""
    from scipy.spatial import ConvexHull, QhullError

    if len(points) < 4:
        raise ValueError("a surface without a volume")
    try:
        return ConvexHull(points)
    except QhullError as error:
        raise ValueError("a flat surface") from error


_LARGEST = 1 << 28  # bytes of a mesh file
_FARTHEST = 1e6  # m


def mesh_shapes(path: Path, scale: tuple[float, float, float]) -> tuple[Any, ...]:
    """Return coal's convex shapes whose union holds a closed mesh, its axes multiplied by scale [3].

    InputError that names the file when it can't be read, is too large or bounds no volume.
    """
    refuse_special(path)
    told = path.stat()
    if told.st_size > _LARGEST:
        raise InputError(f"{path}: a mesh of more than {_LARGEST >> 20} MiB; give a coarser one")
    return _shapes(path, told.st_mtime_ns, scale)


@lru_cache(maxsize=128)
def _shapes(path: Path, _stamp: int, scale: tuple[float, float, float]) -> tuple[Any, ...]:
    import coal

    try:
        mesh = coal.MeshLoader().load(str(path), np.array(scale))
    except (ValueError, RuntimeError) as error:
        raise InputError(f"{path}: a mesh that can't be read") from error
    rows = (mesh.tri_indices(k) for k in range(mesh.num_tris))
    corners = np.array([(row[0], row[1], row[2]) for row in rows], dtype=int).reshape(-1, 3)
    points = np.asarray(mesh.vertices())
    if not np.all(np.abs(points) < _FARTHEST):  # a NaN neither
        raise InputError(
            f"{path}: a mesh with corners that are no places (NaN, or beyond {_FARTHEST:g} m); export it anew"
        )
    try:
        pieces = convex_pieces(points[corners])
    except ValueError as error:
        raise InputError(f"{path}: a mesh that bounds no volume ({error})") from error
    shapes = []
    for piece in pieces:
        points = coal.StdVec_Vec3s()
        points.extend(list(piece))
        shapes.append(coal.Convex.convexHull(points, True, "Qt"))
    return tuple(shapes)


CLEARANCE = 0.01  # m, kept between links where a robot YAML doesn't say
_POSES = 200  # random poses within the position limits that tell which pairs always touch


class MeshMissing(InputError):
    """A mesh that the URDF names isn't on this machine."""


@dataclass(frozen=True)
class Body:
    """A convex body fixed to a joint's frame (0: the base): all points within `swell` [m] of the hull of `points` [V,
    3] m.

    link: the URDF's name of the link.
    """

    link: str
    joint: int
    points: Array
    swell: float


@dataclass(frozen=True)
class Shapes:
    """The bodies of a robot, the pairs that must not touch, and why others aren't looked at.

    model and geometry are Pinocchio's, `geometry.collisionPairs` in the order of `pairs`. Not to be changed.
    """

    model: Any
    geometry: Any
    bodies: tuple[Body, ...]
    pairs: tuple[tuple[int, int], ...]
    notes: tuple[str, ...]


@dataclass(frozen=True)
class Geometry:
    """What the collision geometry of a robot is read from, and what its owner says about it.

    moving and locked as in the robot YAML; lower and upper [n]: position limits. ignored: pairs of links that may
    touch, beside those of the srdf. asked: the robot YAML asks for it, so that a missing mesh is an error. The shapes
    are read when they are first needed.
    """

    urdf: str
    path: Path
    moving: tuple[str, ...]
    locked: Mapping[str, float]
    lower: Array
    upper: Array
    clearance: float = CLEARANCE
    ignored: frozenset[frozenset[str]] = frozenset()
    srdf: Path | None = None
    asked: bool = False
    given: bool = field(init=False)

    def __post_init__(self) -> None:
        """See whether the URDF has collision geometry at all."""
        object.__setattr__(self, "given", "<collision" in self.urdf)

    def __getstate__(self) -> dict[str, Any]:
        """Leave the shapes, which can be read again, out of what goes to other processes."""
        return {entry.name: getattr(self, entry.name) for entry in fields(self)}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Take what came from another process."""
        self.__dict__.update(state)

    @cached_property
    def shapes(self) -> Shapes:
        """The bodies and their pairs; MeshMissing or InputError that names the mesh where they can't be read."""
        full = parse_urdf(self.urdf, self.path)
        geometry = lock_geometry(full, self._read(full), self.moving, self.locked)
        model = lock(full, self.moving, self.locked, self.path)
        bodies = tuple(_body(entry, model) for entry in geometry.geometryObjects)
        return self._paired(model, geometry, bodies)

    def _read(self, model: Any) -> Any:
        """Return Pinocchio's geometry with every mesh replaced by the convex pieces that hold it."""
        import pinocchio

        tree = ElementTree.fromstring(prepared(self.urdf))
        shapes = self._meshes(tree)
        text = ElementTree.tostring(tree, encoding="unicode")
        try:
            with quiet():
                geometry = pinocchio.buildGeomFromUrdfString(model, text, pinocchio.COLLISION)
        except (ValueError, RuntimeError) as error:
            what = str(error).splitlines()[0]
            raise InputError(f"{self.path}: collision geometry that can't be read ({what})") from error
        out = pinocchio.GeometryModel()
        for entry in geometry.geometryObjects:
            for k, shape in enumerate(shapes.get(entry.name, (entry.geometry,))):
                name = f"{entry.name}.{k}"
                place = entry.parentJoint, entry.parentFrame, entry.placement
                out.addGeometryObject(pinocchio.GeometryObject(name, *place, shape))
        return out

    def _meshes(self, tree: ElementTree.Element) -> dict[str, tuple[Any, ...]]:
        """Return the convex pieces of every mesh by the name that Pinocchio gives it, LINK_NUMBER.

        In the tree each mesh gives way to a small ball at its place, so that it isn't read a second time.
        """
        shapes = {}
        for link in tree.iterfind("link"):
            for number, geometry in enumerate(link.iterfind("collision/geometry")):
                mesh = geometry.find("mesh")
                if mesh is None:
                    continue
                name = mesh.get("filename", "")
                found = find_resource(name, self.path.parent)
                if found is None:
                    raise MeshMissing(f"{self.path}: mesh {name!r} was not found")
                x, y, z = map(float, mesh.get("scale", "1 1 1").split())
                shapes[f"{link.get('name')}_{number}"] = mesh_shapes(found.resolve(), (x, y, z))
                geometry.remove(mesh)
                ElementTree.SubElement(geometry, "sphere", radius="0.001")
        return shapes

    def _paired(self, model: Any, geometry: Any, bodies: tuple[Body, ...]) -> Shapes:
        """Return the shapes with the pairs that are looked at: not those of one body or of two joined by a joint, not
        the ignored ones, and not those that touch in every one of many random poses.
        """
        import pinocchio

        links = sorted({body.link for body in bodies})
        for name in sorted({name for pair in self.ignored for name in pair}):
            if not model.existFrame(name):
                known = did_you_mean(name, links)
                raise InputError(f"{self.path}: self_collision: link {name!r} is not in the URDF{known}")
        ignored = self.ignored | (frozenset() if self.srdf is None else frozenset(_disabled_pairs(self.srdf)))
        pairs = [
            (i, j)
            for i, a in enumerate(bodies)
            for j, b in enumerate(bodies)
            if a.joint + 1 < b.joint and frozenset((a.link, b.link)) not in ignored
        ]
        for i, j in pairs:
            geometry.addCollisionPair(pinocchio.CollisionPair(i, j))
        always = self._always_touching(model, geometry)
        for i, j in always:
            geometry.removeCollisionPair(pinocchio.CollisionPair(i, j))
        kept = tuple((int(pair.first), int(pair.second)) for pair in geometry.collisionPairs)
        notes = [
            f"{bodies[i].link} and {bodies[j].link} touch in every pose that was tried: not looked at"
            for i, j in dict.fromkeys(always)
        ]
        return Shapes(model, geometry, bodies, kept, tuple(dict.fromkeys(notes)))

    def _always_touching(self, model: Any, geometry: Any) -> list[tuple[int, int]]:
        import pinocchio

        data, found = model.createData(), geometry.createData()
        touching = np.ones(len(geometry.collisionPairs), dtype=bool)
        for q in self.random_poses(_POSES):
            if not touching.any():
                break
            pinocchio.updateGeometryPlacements(model, data, geometry, found, q)
            for k in np.flatnonzero(touching):
                touching[k] = pinocchio.computeDistance(geometry, found, int(k)).min_distance <= 0.0
        pairs = [geometry.collisionPairs[int(k)] for k in np.flatnonzero(touching)]
        return [(int(pair.first), int(pair.second)) for pair in pairs]

    def random_poses(self, count: int) -> Array:
        """Return random poses [count, n] within the position limits (a turn where there are none), always the same."""
        below = np.where(np.isfinite(self.upper), self.upper - 2.0 * np.pi, -np.pi)
        lower = np.where(np.isfinite(self.lower), self.lower, below)
        upper = np.where(np.isfinite(self.upper), self.upper, lower + 2.0 * np.pi)
        share = np.random.default_rng(0).random((count, len(lower)))
        return np.asarray(lower + (upper - lower) * share)


def _body(entry: Any, model: Any) -> Body:
    """Return the body of a geometry object in its joint's frame."""
    points, swell = _extent(entry.geometry)
    placed = points @ np.array(entry.placement.rotation).T + np.array(entry.placement.translation)
    return Body(str(model.frames[entry.parentFrame].name), int(entry.parentJoint), placed, swell)


def _extent(shape: Any) -> tuple[Array, float]:
    """Return points [V, 3] and a swell that enclose a shape in its own frame."""
    import coal

    if isinstance(shape, coal.ConvexBase):
        return np.array([np.array(shape.point(k)).ravel() for k in range(shape.num_points)]), 0.0
    if isinstance(shape, coal.Box):
        corners = [[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
        return np.array(corners) * np.array(shape.halfSide).ravel(), 0.0
    if isinstance(shape, coal.Capsule | coal.Cylinder):  # a cylinder lies within the capsule about its axis
        return np.array([[0.0, 0.0, -shape.halfLength], [0.0, 0.0, shape.halfLength]]), float(shape.radius)
    shape.computeLocalAABB()
    return np.array(shape.aabb_center).reshape(1, 3), float(shape.aabb_radius)


def _disabled_pairs(path: Path) -> Iterator[frozenset[str]]:
    """Yield the pairs of links that an SRDF lets touch (`disable_collisions`)."""
    try:
        tree = ElementTree.fromstring(read_text(path))
    except ElementTree.ParseError as error:
        raise InputError(f"{path}: can't be read as an SRDF ({error})") from error
    for entry in tree.iter("disable_collisions"):
        yield frozenset((entry.get("link1", ""), entry.get("link2", "")))

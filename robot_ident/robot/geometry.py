"""The bodies of a robot's links: the collision geometry of its URDF as convex pieces."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields
from functools import cached_property
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from robot_ident.errors import InputError, did_you_mean
from robot_ident.files import read_text
from robot_ident.robot.meshes import mesh_shapes
from robot_ident.robot.packages import find_resource
from robot_ident.robot.urdf import lock, lock_geometry, parse_urdf, prepared, quiet
from robot_ident.signals.motion import Array

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

"""Where a frame of the robot may be: half-spaces, cylinders and boxes, each with a signed margin in metres.

A rule is a conjunction of clauses, a clause a disjunction of alternatives: margin = min over clauses of the max over
alternatives of a signed distance, which is 1-Lipschitz in the frame's position and positive where it is allowed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from robot_ident.signals.motion import Array


@dataclass(frozen=True)
class Plane:
    """Signed distance normal . p - offset [m] (unit normal)."""

    normal: tuple[float, float, float]
    offset: float

    def value(self, x: Any, y: Any, z: Any, sqrt: Callable[[Any], Any] = np.sqrt) -> Any:
        """Return the signed distance of (x, y, z), arrays or CasADi expressions."""
        return self.normal[0] * x + self.normal[1] * y + self.normal[2] * z - self.offset


@dataclass(frozen=True)
class Radial:
    """Distance from a line (point, unit axis) less a radius [m]: positive outside of the cylinder; `inside`: its
    negative.
    """

    point: tuple[float, float, float]
    axis: tuple[float, float, float]
    radius: float
    inside: bool = False

    def value(self, x: Any, y: Any, z: Any, sqrt: Callable[[Any], Any] = np.sqrt) -> Any:
        """Return the signed distance of (x, y, z), arrays or CasADi expressions."""
        dx, dy, dz = x - self.point[0], y - self.point[1], z - self.point[2]
        along = dx * self.axis[0] + dy * self.axis[1] + dz * self.axis[2]
        across = dx * dx + dy * dy + dz * dz - along * along
        distance = sqrt(across + 1e-18) - self.radius  # the 1e-18 keeps the derivative finite on the axis
        return -distance if self.inside else distance


Alternative = Plane | Radial
Clause = tuple[Alternative, ...]


@dataclass(frozen=True)
class WorkspaceRule:
    """A rule on the position of one frame; `text` says it in words."""

    frame: str
    clauses: tuple[Clause, ...]
    text: str

    def margin(self, p: Array) -> Array:
        """Return the signed margin [N] m of positions p [N, 3]; negative where the rule is broken."""
        x, y, z = p[:, 0], p[:, 1], p[:, 2]
        best = [np.max([a.value(x, y, z) for a in clause], axis=0) for clause in self.clauses]
        margin: Array = np.min(best, axis=0)
        return margin


def _unit(vector: tuple[float, float, float]) -> tuple[float, float, float]:
    size = float(np.linalg.norm(vector))
    if size < 1e-9:
        raise ValueError("a direction of length zero")
    x, y, z = (float(c) / size for c in vector)
    return x, y, z


def half_space(frame: str, normal: tuple[float, float, float], offset: float) -> WorkspaceRule:
    """Keep normal . p >= offset [m]."""
    n = _unit(normal)
    return WorkspaceRule(frame, ((Plane(n, offset),),), f"{frame} beyond {offset:g} m along {list(normal)}")


def cylinder(
    frame: str,
    point: tuple[float, float, float],
    axis: tuple[float, float, float],
    radius: float,
    lower: float | None,
    upper: float | None,
    *,
    inside: bool = False,
) -> WorkspaceRule:
    """Keep out of (or inside) a cylinder of `radius` about a line, between `lower` and `upper` [m] along its axis
    (None: endless).
    """
    u = _unit(axis)
    start = float(np.dot(u, point))
    span = f" between {'-inf' if lower is None else lower} and {'inf' if upper is None else upper} m"
    text = f"{frame} {'inside' if inside else 'outside'} {radius:g} m of the axis {list(axis)}{span}"
    if inside:
        clauses: tuple[Clause, ...] = ((Radial(point, u, radius, inside=True),),)
        if lower is not None:
            clauses += ((Plane(u, start + lower),),)
        if upper is not None:
            clauses += ((Plane((-u[0], -u[1], -u[2]), -(start + upper)),),)
        return WorkspaceRule(frame, clauses, text)
    clause: tuple[Alternative, ...] = (Radial(point, u, radius),)
    if upper is not None:
        clause += (Plane(u, start + upper),)
    if lower is not None:
        clause += (Plane((-u[0], -u[1], -u[2]), -(start + lower)),)
    return WorkspaceRule(frame, (clause,), text)


def box(
    frame: str, lower: tuple[float, float, float], upper: tuple[float, float, float], *, inside: bool
) -> WorkspaceRule:
    """Keep inside (or out of) an axis-parallel box [m]."""
    sign = 1.0 if inside else -1.0
    faces: list[Alternative] = []
    for axis in range(3):
        e = tuple(sign * float(axis == k) for k in range(3))
        minus = tuple(-c for c in e)
        faces.append(Plane((e[0], e[1], e[2]), sign * lower[axis]))
        faces.append(Plane((minus[0], minus[1], minus[2]), -sign * upper[axis]))
    clauses = tuple((face,) for face in faces) if inside else (tuple(faces),)
    return WorkspaceRule(frame, clauses, f"{frame} {'inside' if inside else 'outside'} the box {lower} to {upper}")

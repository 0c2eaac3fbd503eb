"""Closed surfaces as a few convex pieces that hold them."""

from __future__ import annotations

from functools import cache, cached_property
from typing import Any

import numpy as np

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

"""Closed surfaces as a few convex pieces that hold them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from robot_ident.motion import Array

_PIECES = 4  # most pieces of one mesh
_GAIN = 0.06  # share of the hull's volume that a cut must save
_CUTS = (0.2, 0.4, 0.6, 0.8)  # where planes are tried, as shares of the extent


class _Part(NamedTuple):
    triangles: Array  # [T, 3, 3] m
    volume: float  # of the hull, m^3


def convex_pieces(triangles: Array) -> list[Array]:
    """Return points [V, 3] of convex pieces whose union holds the closed surface of triangles [T, 3, 3] and its inside.

    The surface is cut by planes across its axes, where that saves most of the hulls' volume. What a slab of space holds
    of the solid lies within the hull of what it holds of the surface, so nothing is lost. Raises ValueError for a flat
    or an empty surface.
    """
    whole = _Part(triangles, _volume(triangles))
    parts = [(whole, _best_cut(whole))]
    while len(parts) < _PIECES:
        saved = [0.0 if cut is None else part.volume - cut[0].volume - cut[1].volume for part, cut in parts]
        index = int(np.argmax(saved))
        cut = parts[index][1]
        if cut is None or saved[index] < _GAIN * whole.volume:
            break
        parts[index : index + 1] = [(part, _best_cut(part)) for part in cut]
    return [_corners(part.triangles) for part, _ in parts]


def _best_cut(part: _Part) -> tuple[_Part, _Part] | None:
    """Return the two parts with the least volume into which a plane cuts a part; None where it is nearly convex."""
    if _inside(part.triangles) > (1.0 - _GAIN) * part.volume:
        return None
    low, high = part.triangles.min(axis=(0, 1)), part.triangles.max(axis=(0, 1))
    best: tuple[float, int, float] | None = None
    for axis in range(3):
        for share in _CUTS:
            level = float(low[axis] + share * (high[axis] - low[axis]))
            try:
                volume = sum(_volume(points) for points in _sides(part.triangles, axis, level))
            except ValueError:  # one side is flat or empty
                continue
            if best is None or volume < best[0]:
                best = volume, axis, level
    if best is None:
        return None
    first, second = (_clipped(part.triangles, *best[1:], sign) for sign in (1.0, -1.0))
    return _Part(first, _volume(first)), _Part(second, _volume(second))


def _sides(triangles: Array, axis: int, level: float) -> tuple[Array, Array]:
    """Return points [V, 3] whose hull is that of the surface above a plane, and of the surface below."""
    corners, following = triangles.reshape(-1, 3), np.roll(triangles, -1, axis=1).reshape(-1, 3)
    height, after = corners[:, axis] - level, following[:, axis] - level
    through = height * after < 0.0
    share = (height[through] / (height[through] - after[through]))[:, None]
    on = corners[through] + share * (following[through] - corners[through])
    return np.concatenate([corners[height >= 0.0], on]), np.concatenate([corners[height <= 0.0], on])


def _inside(triangles: Array) -> float:
    """Return the volume inside a closed surface [m^3], by the divergence theorem."""
    a, b, c = (triangles[:, k] - triangles.mean(axis=(0, 1)) for k in range(3))
    return abs(float(np.einsum("ki,ki->", a, np.cross(b, c)))) / 6.0


def _clipped(triangles: Array, axis: int, level: float, sign: float) -> Array:
    """Return the triangles' parts with sign * (x_axis - level) >= 0, as triangles again."""
    height = sign * (triangles[:, :, axis] - level)
    kept = [triangles[np.all(height >= 0.0, axis=1)]]
    for corners, heights in zip(triangles, height, strict=True):
        if heights.min() < 0.0 < heights.max():
            polygon = []
            for k in range(3):
                a, b, p, q = heights[k], heights[k - 2], corners[k], corners[k - 2]
                if a >= 0.0:
                    polygon.append(p)
                if a * b < 0.0:
                    polygon.append(p + a / (a - b) * (q - p))
            kept.append(np.array([[polygon[0], polygon[k], polygon[k + 1]] for k in range(1, len(polygon) - 1)]))
    return np.concatenate([some.reshape(-1, 3, 3) for some in kept])


def _volume(triangles: Array) -> float:
    """Return the volume of the convex hull [m^3]; ValueError where there is none."""
    return float(_hull(triangles).volume)


def _corners(triangles: Array) -> Array:
    hull = _hull(triangles)
    corners: Array = hull.points[hull.vertices]
    return corners


def _hull(triangles: Array):  # type: ignore[no-untyped-def]
    from scipy.spatial import ConvexHull, QhullError

    points = np.unique(triangles.reshape(-1, 3).round(9), axis=0)
    if len(points) < 4:
        raise ValueError("a surface without a volume")
    try:
        return ConvexHull(points)
    except QhullError as error:
        raise ValueError("a flat surface") from error

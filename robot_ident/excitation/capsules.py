"""Capsules about bodies: a quick lower bound of the distance between them, for many poses at once."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from robot_ident.signals.motion import Array


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

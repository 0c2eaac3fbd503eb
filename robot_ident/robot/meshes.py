"""Mesh files of links as convex shapes; each file is read once in a process."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from robot_ident.errors import InputError
from robot_ident.files import refuse_special
from robot_ident.robot.convex import convex_pieces

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

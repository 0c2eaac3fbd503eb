"""From the ten standard parameters of a link to mass, centre and inertia about the centre, which files hold."""

from __future__ import annotations

import numpy as np

from robot_ident.signals.motion import Array


def about_centre(ten: Array) -> tuple[float, Array, Array]:
    """Return mass [kg], centre of mass [3] m and inertia about it [3, 3] kg m^2: I_c = I - m (c'c 1 - c c')."""
    mass, centre = float(ten[0]), ten[1:4] / ten[0]
    xx, xy, yy, xz, yz, zz = ten[4:]
    about_origin = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return mass, centre, about_origin - mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))

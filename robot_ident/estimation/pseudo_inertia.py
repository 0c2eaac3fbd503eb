"""The pseudo-inertia of a link: what says whether its ten parameters can be those of a body.

A link with mass m, first moment h and inertia I about its frame is a body of non-negative density exactly when J =
[[Sigma, h], [h', m]], Sigma = tr(I) / 2 - I, is positive semidefinite (Wensing, Kim and Slotine, "Linear matrix
inequalities for physically consistent inertial parameter identification", 2018).
"""

from __future__ import annotations

import numpy as np

from robot_ident.robot.rigid_body import STANDARD
from robot_ident.signals.motion import Array

LEAST = 1e-5
"""Smallest eigenvalue, kg and kg m^2, that a link's pseudo-inertia is given where the data would have it vanish."""

LENGTH = 0.3
"""Size of a link [m], which scales its moments."""

PLACE = {name: place for place, name in enumerate(STANDARD)}


def least_eigenvalues(standard: Array) -> Array:
    """Return the smallest eigenvalue of every link's pseudo-inertia [n], of standard parameters [10 n]."""
    links = np.asarray(standard).reshape(-1, 10)
    inertia = np.empty((len(links), 3, 3))
    for (row, column), name in {
        (0, 0): "Ixx", (0, 1): "Ixy", (0, 2): "Ixz", (1, 1): "Iyy", (1, 2): "Iyz", (2, 2): "Izz"
    }.items():  # fmt: skip
        inertia[:, row, column] = inertia[:, column, row] = links[:, PLACE[name]]
    out = np.empty((len(links), 4, 4))
    out[:, :3, :3] = 0.5 * np.trace(inertia, axis1=1, axis2=2)[:, None, None] * np.eye(3) - inertia
    out[:, :3, 3] = out[:, 3, :3] = links[:, 1:4]
    out[:, 3, 3] = links[:, 0]
    return np.asarray(np.linalg.eigvalsh(out)[:, 0])


def _triangle() -> Array:
    """Return the matrix [10, 10] from standard parameters to the upper triangle of J, by columns, off-diagonal entries
    times sqrt 2.
    """
    root = np.sqrt(2.0)
    out = np.zeros((10, 10))
    xx, xy, yy, xz, yz, zz = (PLACE[name] for name in ("Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz"))
    for row, minus in ((0, xx), (2, yy), (5, zz)):
        out[row, [xx, yy, zz]] = 0.5
        out[row, minus] = -0.5
    for row, product in ((1, xy), (3, xz), (4, yz)):
        out[row, product] = -root
    for row, moment in ((6, "mx"), (7, "my"), (8, "mz")):
        out[row, PLACE[moment]] = root
    out[9, PLACE["m"]] = 1.0
    return out


TRIANGLE = _triangle()

IDENTITY = np.array([1.0, 0, 1.0, 0, 0, 1.0, 0, 0, 0, 1.0])
"""The upper triangle of the unit matrix [10]."""

"""A mass on a spring along a motion: what follows a force late, rings, and settles."""

from __future__ import annotations

import numpy as np

from robot_ident.signals.derivatives import step
from robot_ident.signals.motion import Array, Motion


def driven(
    motion: Motion, force: Array, inertia: Array, damping: Array, stiffness: Array
) -> tuple[Array, Array, Array]:
    """Return x, dx/dt and d2x/dt2 [N] of m x'' + d x' + k x = f, all of them [N] along a motion of even samples.

    Over a period of a periodic motion the settled solution; elsewhere it begins at rest where the force holds it. By
    the rule of constant average acceleration, x between two samples averaged (Newmark 1959): stable for m, d >= 0 and k
    > 0, right to (2 pi f dt)^2 / 12 of the frequency f of its free motion.
    """
    from scipy.linalg import solve_banded

    samples, dt = len(force), step(motion)
    mean = (np.roll(force, 1) + 2.0 * force + np.roll(force, -1)) / 4.0
    mass, drag, spring = inertia / dt**2, damping / (2.0 * dt), stiffness / 4.0
    if not motion.periodic:
        mean[0], mean[-1] = force[0], force[-1]
    # row i: (m - d + k) x[i-1] + 2 (k - m) x[i] + (m + d + k) x[i+1] = mean[i], from x[-1] and x[0]
    band = np.ones((3, samples + 2))
    band[0, 2:], band[1, 1:-1], band[2, :-2] = mass + drag + spring, 2.0 * (spring - mass), mass - drag + spring
    band[1, 0] = 0.0
    right = np.zeros((samples + 2, 3))
    right[2:, 0] = mean
    right[0, 1] = right[1, 2] = 1.0
    if not motion.periodic:
        right[:2, 0] = force[0] / stiffness[0]
        x = solve_banded((2, 0), band, right[:, 0])
    else:
        settled, first, second = solve_banded((2, 0), band, right).T
        back = np.array([[first[-2], second[-2]], [first[-1], second[-1]]])  # what starts are after a period
        start = np.linalg.solve(np.eye(2) - back, settled[-2:])
        x = settled + first * start[0] + second * start[1]
    before, here, after = x[:-2], x[1:-1], x[2:]
    return here, (after - before) / (2.0 * dt), (after - 2.0 * here + before) / dt**2

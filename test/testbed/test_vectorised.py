"""CasADi functions on many instants at once, against CasADi itself."""

from __future__ import annotations

import casadi as ca
import numpy as np

from robot_ident.testbed.vectorised import BLOCKS, vectorised


def test_any_number_of_instants() -> None:
    x, y = ca.SX.sym("x", 2), ca.SX.sym("y")
    function = ca.Function("f", [x, y], [ca.sin(x) * y, x[0] ** 2])
    run, rng = vectorised(function), np.random.default_rng(0)
    for count in (0, 1, sum(BLOCKS), 3 * BLOCKS[0] - 1, 1):
        values = rng.standard_normal((count, 2)), rng.standard_normal((3, count)).T[:, 1:2]
        first, second = run(*values)
        np.testing.assert_array_equal(first, np.sin(values[0]) * values[1])
        np.testing.assert_array_equal(second, values[0][:, :1] ** 2)

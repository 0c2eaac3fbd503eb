"""Least squares by normal equations against a factorization of the rows."""

from __future__ import annotations

import numpy as np

from robot_ident.regression.normal_equations import least_squares


def test_columns_that_are_nearly_alike_are_told_as_by_a_factorization() -> None:
    rng = np.random.default_rng(0)
    a = rng.standard_normal((300, 5)) * [1.0, 1e-3, 1e4, 1.0, 1.0]
    a[:, 4] = a[:, 3] + 1e-4 * a[:, 4]
    y = a @ [1.0, -2e3, 1e-4, 0.5, 0.25] + 1e-3 * rng.standard_normal(300)
    expected = np.linalg.lstsq(a, y, rcond=None)[0]
    np.testing.assert_allclose(least_squares(np.split(a, 3), np.split(y, 3)), expected, rtol=1e-8)


def test_what_the_data_leave_open_is_shared() -> None:
    rng = np.random.default_rng(1)
    a = rng.standard_normal((100, 3))
    a = np.concatenate([a, a[:, :1], np.zeros((100, 1))], axis=1)
    y = a @ [2.0, 1.0, -1.0, 0.0, 0.0]
    np.testing.assert_allclose(least_squares([a], [y]), [1.0, 1.0, -1.0, 1.0, 0.0], atol=1e-10)

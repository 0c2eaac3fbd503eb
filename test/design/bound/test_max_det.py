"""The interior-point method, against optimality conditions and a classical design."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import linprog

from robot_ident.design.bound.relaxation import maximise_log_det


def test_quadratic_regression() -> None:
    """On [-1, 1] the D-optimal weights of 1, x, x^2 are a third at -1, 0 and 1 each (Fedorov 1972)."""
    x = np.linspace(-1.0, 1.0, 41)
    rows = np.stack([np.ones_like(x), x, x**2], axis=1)[:, None, :]
    found = maximise_log_det(rows, np.zeros((41, 0)), np.zeros((41, 0)), np.zeros((3, 3)), gap=1e-8)
    assert found.xi[[0, 20, 40]] == pytest.approx(np.full(3, 1 / 3), abs=1e-4)
    assert found.gap < 1e-8
    assert found.total == pytest.approx(3.0, abs=1e-6)


def test_optimality_with_constraints_and_prior() -> None:
    """Feasible weights, multipliers of the right sign, and a dual value that meets the primal one."""
    rng = np.random.default_rng(1)
    rows, equal, unequal = rng.normal(size=(150, 2, 6)), rng.normal(size=(150, 8)), rng.normal(size=(150, 3))
    prior = np.diag([0.0, 0.0, 0.3, 0.0, 0.1, 0.0])
    found = maximise_log_det(rows, equal, unequal, prior, gap=1e-6)
    assert found.xi.min() > 0.0 and found.xi.sum() == pytest.approx(1.0)
    assert np.abs(equal.T @ found.xi).max() < 1e-6 and (unequal.T @ found.xi).max() < 1e-6
    assert found.unequal.min() > -1e-8
    inverse = np.linalg.inv(found.information)
    prices = np.einsum("kij,jl,kil->k", rows, inverse, rows) - equal @ found.equal - unequal @ found.unequal
    total = prices.max() + np.sum(inverse * prior)
    assert 0.0 <= 6 * np.log(total / 6) < 1e-5


def test_random_feasible_weights_are_no_better() -> None:
    rng = np.random.default_rng(2)
    rows, equal = rng.normal(size=(60, 1, 4)), rng.normal(size=(60, 2))
    best = np.linalg.slogdet(maximise_log_det(rows, equal, np.zeros((60, 0)), np.zeros((4, 4))).information)[1]
    matrix = np.vstack([equal.T, np.ones(60)])
    inside = linprog(np.zeros(60), A_eq=matrix, b_eq=[0.0, 0.0, 1.0], bounds=(0.005, 1.0)).x
    for _ in range(200):
        way = rng.normal(size=60)
        way -= np.linalg.pinv(matrix) @ (matrix @ way)
        xi = inside + rng.random() * way * np.min(inside / np.abs(way))
        assert xi.min() >= 0.0 and np.abs(equal.T @ xi).max() < 1e-9
        assert np.linalg.slogdet(np.einsum("k,kij,kil->jl", xi, rows, rows))[1] <= best + 1e-6

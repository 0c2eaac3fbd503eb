"""Nuisance columns of known size: the products are those of fitting them, too, with what is known of their size."""

from __future__ import annotations

import numpy as np

from robot_ident.regression.hidden_path import Nuisance, products, without


def test_products_give_the_fit_and_the_loss_of_the_longer_one() -> None:
    """min over x, h of |y - A x - K h|^2 + |h|^2, written out: least squares with a row for every coefficient of K."""
    rng = np.random.default_rng(3)
    n, rows, k = 2, (40, 30), 7
    y = [rng.standard_normal((count, n)) for count in rows]
    a = [rng.standard_normal((count, n, 3)) for count in rows]
    kinks = [3.0 * rng.standard_normal((count, n, k)) for count in rows]
    stacked = [np.concatenate([part.reshape(n * len(part), -1) for part in parts]) for parts in (a, kinks, y)]
    long = np.block([[stacked[0], stacked[1]], [np.zeros((k, 3)), np.eye(k)]])
    right = np.concatenate([stacked[2][:, 0], np.zeros(k)])
    expected, loss, *_ = np.linalg.lstsq(long, right, rcond=None)

    groups = [Nuisance.of((0, 1), kinks)]
    square = products(groups, [np.concatenate([part, one[:, :, None]], axis=2) for part, one in zip(a, y, strict=True)])
    found = np.linalg.solve(square[:3, :3], square[:3, 3])
    np.testing.assert_allclose(found, expected[:3], rtol=1e-9)
    np.testing.assert_allclose(square[3, 3] - square[:3, 3] @ found, loss[0], rtol=1e-9)

    left = without(groups, [one - part @ found for one, part in zip(y, a, strict=True)])
    stacked_left = np.concatenate([part.ravel() for part in left])
    np.testing.assert_allclose(stacked_left, (right - long @ expected)[: len(stacked_left)], rtol=1e-7, atol=1e-9)


def test_a_nuisance_touches_its_own_places_alone() -> None:
    rng = np.random.default_rng(4)
    y = [rng.standard_normal((20, 2)) for _ in range(3)]
    groups = [Nuisance.of((1,), [rng.standard_normal((20, 2, 4))])]
    made = without(groups, y)
    np.testing.assert_array_equal(made[0], y[0])
    np.testing.assert_array_equal(made[2], y[2])
    assert np.linalg.norm(made[1]) < np.linalg.norm(y[1])

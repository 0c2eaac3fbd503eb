"""Nuisance columns of known size: the products are those of fitting them, too, with what is known of their size."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from robot_ident.regression.evidence import Trajectory
from robot_ident.regression.hidden_path import Nuisance, products, without


def trajectory(rng: np.random.Generator, rows: int, n: int, whitened: bool) -> Trajectory:
    """Return a trajectory of which some rows count, its lines in units of their own noise or all alike."""
    weight = rng.uniform(0.5, 2.0, (rows, n)) * (rng.uniform(size=(rows, 1)) < 0.7)
    whitening = rng.uniform(0.5, 2.0, (rows // 2 + 1, n)) if whitened else None
    nothing: Any = None
    return Trajectory(nothing, nothing, weight, np.zeros((rows, n)), np.ones(n), whitening)


@pytest.mark.parametrize("rows", [40, 41])
@pytest.mark.parametrize("whitened", [True, False])
def test_products_give_the_fit_and_the_loss_of_the_longer_one(rows: int, whitened: bool) -> None:
    """min over x, h of |y - A x - K h|^2 + |h|^2, written out: least squares with a row for every coefficient of K."""
    rng = np.random.default_rng(3)
    n, k = 2, 7
    whole = trajectory(rng, rows, n, whitened)
    parts = [whole.part(slice(15)), whole.part(slice(15, None))]
    y = [one.cut(rng.standard_normal((rows, n))) for one in parts]
    a = [one.cut(rng.standard_normal((rows, n, 3))) for one in parts]
    torques = 3.0 * rng.standard_normal((rows, n, k))
    kinks = [one.in_noise(torques) for one in parts]
    np.testing.assert_allclose(sum(kinks), whole.in_noise(torques))
    stacked = [np.concatenate([of.reshape(n * rows, -1) for of in both]) for both in (a, kinks, y)]
    long = np.block([[stacked[0], stacked[1]], [np.zeros((k, 3)), np.eye(k)]])
    right = np.concatenate([stacked[2][:, 0], np.zeros(k)])
    expected, loss, *_ = np.linalg.lstsq(long, right, rcond=None)

    group = Nuisance.of((0, 1), parts, np.split(torques, [2, 5], axis=2))
    assert group is not None
    every = [np.concatenate([of, one[:, :, None]], axis=2) for of, one in zip(a, y, strict=True)]
    square = products([group], parts, every)
    found = np.linalg.solve(square[:3, :3], square[:3, 3])
    np.testing.assert_allclose(found, expected[:3], rtol=1e-9)
    np.testing.assert_allclose(square[3, 3] - square[:3, 3] @ found, loss[0], rtol=1e-9)

    left = without([group], [one - of @ found for one, of in zip(y, a, strict=True)])
    stacked_left = np.concatenate([one.ravel() for one in left])
    np.testing.assert_allclose(stacked_left, (right - long @ expected)[: len(stacked_left)], rtol=1e-7, atol=1e-9)


def test_a_nuisance_touches_its_own_places_alone() -> None:
    rng = np.random.default_rng(4)
    y = [rng.standard_normal((20, 2)) for _ in range(3)]
    group = Nuisance.of((1,), [trajectory(rng, 20, 2, False)], [rng.standard_normal((20, 2, 4))])
    assert group is not None
    made = without([group], y)
    np.testing.assert_array_equal(made[0], y[0])
    np.testing.assert_array_equal(made[2], y[2])
    assert np.linalg.norm(made[1]) < np.linalg.norm(y[1])


def test_columns_that_make_nothing_are_left_out() -> None:
    rng = np.random.default_rng(5)
    torques = rng.standard_normal((20, 2, 4)) * [1.0, 1e-3, 1.0, 1e-3]
    group = Nuisance.of((0,), [trajectory(rng, 20, 2, True)], [torques], least=1e-2)
    assert group is not None and group.square.shape == (2, 2)
    assert Nuisance.of((0,), [trajectory(rng, 20, 2, True)], [1e-3 * torques], least=1e-2) is None

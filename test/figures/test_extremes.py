"""Fewer points of long curves: no extreme is lost, no value is made."""

from __future__ import annotations

import numpy as np
import pytest

from robot_ident.figures.residual_scatter import binned
from robot_ident.figures.theme import POINTS, extremes, extremes_along
from robot_ident.figures.torque_over_time import torque_figure
from robot_ident.residuals.beside import Beside
from robot_ident.robot import load_robot


@pytest.mark.parametrize("count", [10, POINTS, POINTS + 1, 123_457])
def test_extremes_stay(count: int) -> None:
    y = np.random.default_rng(count).normal(size=count)
    y[count // 3] = 50.0
    rows = extremes(y)
    assert len(rows) <= POINTS
    assert np.all(np.diff(rows) > 0)
    assert y[rows].max() == 50.0
    assert y[rows].min() == y.min()
    if count <= POINTS:
        assert len(rows) == count


def test_every_stretch_keeps_its_own_extremes() -> None:
    y = np.sin(np.linspace(0.0, 400.0, 50_000)) * np.linspace(1.0, 3.0, 50_000)
    drawn = y[extremes(y, 200)]
    edges = np.linspace(0, len(y), 101).astype(int)
    for a, b in zip(edges[:-1], edges[1:], strict=True):
        assert y[a:b].max() in drawn
        assert y[a:b].min() in drawn


def test_a_gap_stays_a_gap() -> None:
    y = np.ones(10_000)
    y[4000:6000] = np.nan
    drawn = y[extremes(y, 100)]
    assert np.isnan(drawn).sum() == 10  # one of each stretch without a value


def test_a_cloud_is_thinned_along_its_abscissa() -> None:
    rng = np.random.default_rng(1)
    x, y = rng.normal(size=(2, 20_000))
    rows = extremes_along(x, y, 400)
    assert np.all(np.diff(x[rows]) >= 0)
    assert {int(np.argmax(y)), int(np.argmin(y))} <= set(rows.tolist())


def test_a_million_rows_become_a_small_figure_with_every_peak() -> None:
    robot, count = load_robot(), 1_000_000
    rng = np.random.default_rng(2)
    t, zero = np.arange(count) / 1000.0, np.zeros((count, 3))
    measured = rng.normal(size=(count, 3))
    measured[777_777] = 99.0
    used = np.ones((count, 3), dtype=bool)
    one = Beside("long", robot, t, zero, zero, zero, zero, measured, zero, used, np.ones(3), 1.0, 1, None, None)
    figure = torque_figure({"model": one})
    assert len(figure.to_json()) < 600_000
    for trace in figure.data:
        if trace.name in ("measured", "residual, model"):
            assert np.max(trace.y) == 99.0
            assert np.asarray(trace.x)[np.argmax(trace.y)] == pytest.approx(777.777, abs=1e-3)


def test_the_mean_of_a_bin_and_what_noise_leaves_of_it() -> None:
    rng = np.random.default_rng(3)
    x, noise = rng.uniform(-1.0, 1.0, 48_000), rng.normal(size=48_000)
    found = binned([x[:16_000], x[16_000:]], [2.0 * x[:16_000], 2.0 * x[16_000:] + noise[16_000:]],
                   [np.ones(16_000, bool), np.ones(32_000, bool)], [0.0, 1.0], 24)  # fmt: skip
    assert len(found.middle) == 24
    assert np.allclose(found.spread, np.sqrt((2.0 / 3.0) / 2000.0), rtol=0.02)
    assert np.max(np.abs(found.mean - 2.0 * found.middle) / found.spread) < 4.5

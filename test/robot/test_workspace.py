"""Workspace rules: signed distances, positive where the frame may be."""

from __future__ import annotations

import numpy as np
import pytest

from robot_ident.robot import load_robot
from robot_ident.robot.workspace import box, cylinder, half_space


def test_kuka_rules_are_the_papers() -> None:
    points = np.array([[0.8, 0, 1.0], [0.8, 0, 0.7], [0.5, 0, 1.0], [0.5, 0, 2.0], [0, 0, 2.3], [0, 0.69, 1.79]])
    margins = np.min([rule.margin(points) for rule in load_robot().workspace], axis=0)
    np.testing.assert_array_equal(margins > 0, [True, False, False, True, True, False])


@pytest.mark.parametrize(
    "rule",
    [
        half_space("f", (1.0, 2.0, -1.0), 0.3),
        cylinder("f", (0.1, 0.2, 0.0), (0.0, 1.0, 1.0), 0.4, -0.2, 0.5),
        box("f", (-0.5, -0.4, -0.3), (0.5, 0.4, 0.3), inside=True),
        box("f", (-0.5, -0.4, -0.3), (0.5, 0.4, 0.3), inside=False),
    ],
)
def test_margin_never_grows_faster_than_the_point_moves(rule: object) -> None:
    rng = np.random.default_rng(0)
    a = rng.uniform(-1, 1, (4000, 3))
    b = a + 0.05 * rng.normal(size=a.shape)
    change = np.abs(rule.margin(b) - rule.margin(a))  # type: ignore[attr-defined]
    assert np.all(change <= np.linalg.norm(b - a, axis=1) + 1e-8)


def test_cylinder_stands_where_its_ends_say() -> None:
    rule = cylinder("f", (0.0, 0.0, 1.0), (0.0, 0.0, 1.0), 0.5, 0.0, 1.0)
    inside = np.array([[0.1, 0.1, 1.5]])
    outside = np.array([[0.1, 0.1, 2.1], [0.1, 0.1, 0.9], [0.6, 0, 1.5]])
    assert np.all(rule.margin(inside) < 0)
    assert np.all(rule.margin(outside) > 0)

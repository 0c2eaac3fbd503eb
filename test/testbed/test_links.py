"""The plant's own dynamics against Pinocchio."""

from __future__ import annotations

import numpy as np
import pinocchio

from robot_ident.robot import Robot
from robot_ident.testbed.links import links_function


def _compare(robot: Robot) -> None:
    rng, links, model = np.random.default_rng(0), links_function(robot), robot.rigid.model
    data = model.createData()
    for _ in range(10):
        q, v = rng.uniform(-2, 2, (2, robot.n))
        mass, bias = (np.array(part) for part in links(q, v))
        expected = pinocchio.crba(model, data, q)
        expected = np.triu(expected) + np.triu(expected, 1).T
        np.testing.assert_allclose(mass, expected, atol=1e-11)
        np.testing.assert_allclose(bias[:, 0], pinocchio.rnea(model, data, q, v, np.zeros(robot.n)), atol=1e-11)


def test_kuka(kuka: Robot) -> None:
    _compare(kuka)


def test_other_arms(arm: Robot) -> None:
    _compare(arm)

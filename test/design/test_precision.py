"""How many periods a parameter takes: the number after which its sigma is small enough, and not one more."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from robot_ident.design.target import Target, periods_needed


def needed(information: Any, values: Any, share: float, prior: Any = None) -> list[int | None]:
    names = [f"p{k}" for k in range(len(values))]
    return [one.periods for one in periods_needed(information, values, names, ["kg"] * len(values), share, prior)]


def test_sigma_falls_with_the_root_of_the_number() -> None:
    # sigma of one period is 1 / sqrt(4) = 0.5 of a value of 2: 5 % is 0.1, so 25 periods
    assert needed(np.diag([4.0, 1e4]), np.array([2.0, 1.0]), 0.05) == [25, 1]


def test_what_is_known_already_counts() -> None:
    # 100 - 75 of information are lacking, 4 a period
    assert needed(np.diag([4.0]), np.array([2.0]), 0.05, np.diag([75.0])) == [7]
    assert needed(np.diag([4.0]), np.array([2.0]), 0.05, np.diag([150.0])) == [1]


def test_what_can_not_be_told_is_never_enough() -> None:
    one = np.array([[1.0, 1.0], [1.0, 1.0]])  # only the sum shows
    assert needed(one, np.array([1.0, 1.0]), 0.05) == [None, None]
    assert needed(np.eye(1), np.zeros(1), 0.05) == [None]


def test_the_number_is_the_least_for_a_real_motion(arm: Any, designed: Any) -> None:
    target = Target.of_robot(arm.robot)
    rows = target.rows(designed.excitation) / np.sqrt(target.periods)
    values = arm.structure.true_values()
    found = periods_needed(
        rows.T @ rows, values, target.structure.names, [p.unit for p in target.structure.parameters], 0.05
    )
    for one, sigma, value in zip(found, designed.sigma, values, strict=True):
        assert one.sigma == pytest.approx(sigma * np.sqrt(16), rel=1e-6)  # the design says sigma of 16 periods
        count = max(1, int(np.ceil((one.sigma / (0.05 * abs(value))) ** 2 - 1e-6)))
        assert one.periods == (count if count <= 1_000_000 else None)

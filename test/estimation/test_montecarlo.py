"""Section IV of the paper: unbiased and efficient, judged exactly."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from robot_ident.errors import InputError
from robot_ident.testbed.monte_carlo import montecarlo


def test_200_runs_are_unbiased_and_efficient(arm: Any) -> None:
    motion = arm.series.motion(np.arange(1500) / 150)
    result = montecarlo(motion, arm.structure, np.array([25.0, 26.0, 10.0]), runs=200, seed=0)
    assert 6.4 <= result.bias_statistic <= 46.8
    assert result.error_statistic == pytest.approx(1.0, abs=0.066)
    assert result.holds
    assert result.ratio_interval == pytest.approx((0.919, 1.084), abs=5e-4)
    assert result.inside_mean >= 8
    assert result.inside_ratio >= 14


def test_a_wrong_truth_is_noticed(arm: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    motion = arm.series.motion(np.arange(1500) / 150)
    truth = arm.structure.true_values()
    good = montecarlo(motion, arm.structure, np.array([25.0, 26.0, 10.0]), runs=50)
    # half a sigma of bias in one parameter is 50 * 0.25 or more in the statistic
    assert good.bias_statistic < 50 * 0.25 + 21
    assert np.all(np.abs(good.mean - truth) < good.sigma)


@pytest.mark.parametrize(
    ("variance", "runs", "words"),
    [
        ([25.0, 0.0, 10.0], 10, "joint_2 is unknown or zero.*torque_variance"),
        ([25.0, np.nan, 10.0], 10, "noise of joint_2 is unknown"),
        ([25.0, 26.0, 10.0], 1, "at least 2"),
    ],
)
def test_bad_input(arm: Any, variance: list[float], runs: int, words: str) -> None:
    with pytest.raises(InputError, match=words):
        montecarlo(arm.series.motion(np.arange(100) / 10), arm.structure, np.array(variance), runs=runs)

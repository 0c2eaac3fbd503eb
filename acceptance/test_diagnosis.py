"""Hidden effects found: the table of rates with their intervals, on seeds that no development has used.

ROBOT_IDENT_TRIAL_CASES: cases of each row (300). ROBOT_IDENT_ACCEPTANCE: folder (build/acceptance) that keeps finished
cases; what was stopped goes on from them.
"""

from __future__ import annotations

import pytest
from arms import write_arm
from table import CASES, FOLDER, rate_of
from trials import trial

QUIET = 1 / 16
NULL_CASES = max(CASES, CASES * 4 // 3)

AT_LEAST = [
    ("single", QUIET, "named_right", 0.97),
    ("single", 1.0, "named_right", 0.95),
    ("single", 1.0, "truth_in_tie_group", 0.99),
    ("pair_other_joints", 1.0, "pair_found_nothing_else", 0.93),
    ("single_with_background", 1.0, "named_right_with_background", 0.94),
]
AT_MOST = [
    ("single", 1.0, "wrong_name_outside_tie", 0.005),
    ("unknown", 1.0, "unknown_named", 0.01),
]


@pytest.mark.parametrize(("kind", "noise", "name", "least"), AT_LEAST)
def test_found_as_often_as_promised(kind: str, noise: float, name: str, least: float) -> None:
    """The promised rate is not above the interval that the cases leave."""
    rate = rate_of(trial(kind, noise), name)
    assert rate["upper"] >= least, rate


@pytest.mark.parametrize(("kind", "noise", "name", "most"), AT_MOST)
def test_wrong_no_more_often_than_promised(kind: str, noise: float, name: str, most: float) -> None:
    """The promised rate is not below the interval that the cases leave."""
    rate = rate_of(trial(kind, noise), name)
    assert rate["lower"] <= most, rate


def test_nothing_hidden_gets_no_name() -> None:
    rate = rate_of(trial("null", cases=NULL_CASES), "false_name_on_null")
    assert rate["lower"] <= 0.005, rate


def test_adding_removes_the_error() -> None:
    """On a motion that no fit has seen."""
    removed = trial("single")["error_removed"]
    assert removed["median"] >= 0.95
    assert removed["tenth_percentile"] >= 0.80


def test_a_diagnosis_is_quick() -> None:
    assert trial("single")["diagnosis_seconds"]["median"] <= 3.0


@pytest.mark.parametrize("arm", ["ur5", "panda"])
def test_larger_arms_fare_no_worse(arm: str) -> None:
    """Six and seven axes at a tenth of the torque: within three points of three axes."""
    data = trial("single", robot=str(write_arm(arm, FOLDER)), cases=CASES // 3)
    assert rate_of(data, "named_right")["upper"] >= 0.95 - 0.03
    assert rate_of(data, "truth_in_tie_group")["upper"] >= 0.99 - 0.03
    assert rate_of(data, "wrong_name_outside_tie")["lower"] <= 0.005 + 0.03
    assert data["error_removed"]["median"] >= 0.95 - 0.03
    assert data["error_removed"]["tenth_percentile"] >= 0.80 - 0.03

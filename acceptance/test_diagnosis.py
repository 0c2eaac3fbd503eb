"""Hidden effects found: the table of rates with their intervals, on seeds that no development has used.

ROBOT_IDENT_TRIAL_CASES: cases of each row (300). ROBOT_IDENT_FIRST_SEED: of the cases (11000).
ROBOT_IDENT_ACCEPTANCE: folder (build/acceptance) that keeps finished
cases; what was stopped goes on from them.
"""

from __future__ import annotations

from typing import Any

import pytest
from arms import write_arm
from table import CASES, FOLDER, rate_of
from trials import trial

QUIET = 1 / 16
NULL_CASES = max(CASES, CASES * 4 // 3)
WITHIN = 0.03  # of a three-axis arm's rates, those of six and seven axes

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
@pytest.mark.parametrize(("kind", "noise", "name", "least"), AT_LEAST)
def test_larger_arms_are_found_as_often(arm: str, kind: str, noise: float, name: str, least: float) -> None:
    """Six and seven axes at a tenth of the torque: within three points of three axes."""
    assert rate_of(_of_arm(arm, kind, noise), name)["upper"] >= least - WITHIN


@pytest.mark.parametrize("arm", ["ur5", "panda"])
@pytest.mark.parametrize(("kind", "noise", "name", "most"), [*AT_MOST, ("null", 1.0, "false_name_on_null", 0.005)])
def test_larger_arms_are_no_more_often_wrong(arm: str, kind: str, noise: float, name: str, most: float) -> None:
    assert rate_of(_of_arm(arm, kind, noise), name)["lower"] <= most + WITHIN


@pytest.mark.parametrize("arm", ["ur5", "panda"])
def test_adding_removes_the_error_of_larger_arms(arm: str) -> None:
    removed = _of_arm(arm, "single", 1.0)["error_removed"]
    assert removed["median"] >= 0.95 - WITHIN
    assert removed["tenth_percentile"] >= 0.80 - WITHIN


def _of_arm(arm: str, kind: str, noise: float) -> dict[str, Any]:
    return trial(kind, noise, str(write_arm(arm, FOLDER)), CASES // 2)

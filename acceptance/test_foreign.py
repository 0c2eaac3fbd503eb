"""What a second simulator hides, whose formulas, servo and noise are its own, found by the same diagnosis."""

from __future__ import annotations

from functools import cache, partial
from typing import Any

import pytest
from foreign.run import run_case
from table import CASES, FIRST_SEED, FOLDER, print_rates, rate_of
from trials import judged, trial

LEAST = 1.0  # Nm rms that an effect has to leave to be counted


@cache
def outcomes(kind: str, cases: int) -> dict[str, Any]:
    """Return the summary of all cases of a kind."""
    trial("null", cases=1)  # designs the motions where there are none yet
    files = sorted(FOLDER.glob("kuka_ir361_[1-4].yaml"))
    seeds = range(FIRST_SEED, FIRST_SEED + cases)
    run = partial(run_case, kind=kind, files=files)
    data = judged(f"foreign_{kind}", run, seeds, LEAST)
    print_rates(f"second simulator, {kind}", data)
    return data


def test_named_right() -> None:
    """Formulas that are not the catalogue's: as often as promised, within the interval that the cases leave."""
    rate = rate_of(outcomes("known", CASES), "named_right")
    assert rate["upper"] >= 0.95, rate


def test_truth_in_the_tie_group() -> None:
    rate = rate_of(outcomes("known", CASES), "truth_in_tie_group")
    assert rate["upper"] >= 0.99, rate


def test_adding_removes_the_error() -> None:
    removed = outcomes("known", CASES)["error_removed"]
    assert removed["median"] >= 0.95
    assert removed["tenth_percentile"] >= 0.80


@pytest.mark.parametrize(
    ("kind", "name", "most"), [("unknown", "unknown_named", 0.01), ("null", "false_name_on_null", 0.005)]
)
def test_no_name_without_a_cause(kind: str, name: str, most: float) -> None:
    rate = rate_of(outcomes(kind, CASES // 2), name)
    assert rate["lower"] <= most, rate

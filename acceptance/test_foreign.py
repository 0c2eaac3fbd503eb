"""What a second simulator hides, whose formulas, servo and noise are its own, found by the same diagnosis."""

from __future__ import annotations

import json
from functools import cache, partial
from typing import Any

import pytest
from foreign.run import run_case
from table import CASES, FIRST_SEED, FOLDER, print_rates, rate_of
from trials import trial

from robot_ident.parallel import completed
from robot_ident.testbed.trial import Outcome
from robot_ident.testbed.trial_table import summary

LEAST = 1.0  # Nm rms that an effect has to leave to be counted


@cache
def outcomes(kind: str, cases: int) -> dict[str, Any]:
    """Return the summary of all cases of a kind; finished ones are read from the folder."""
    trial("null", cases=1)  # designs the motions where there are none yet
    files = sorted(FOLDER.glob("kuka_ir361_[1-4].yaml"))
    journal = FOLDER / f"foreign_{kind}.jsonl"
    lines = journal.read_text(encoding="utf-8").splitlines() if journal.exists() else []
    done = {outcome.seed: outcome for outcome in (Outcome.of_dict(json.loads(line)) for line in lines)}
    seeds = [seed for seed in range(FIRST_SEED, FIRST_SEED + cases) if seed not in done]
    with journal.open("a", encoding="utf-8") as file:
        for _, outcome in completed(partial(run_case, kind=kind, files=files), seeds):
            done[outcome.seed] = outcome
            file.write(json.dumps(outcome.to_dict()) + "\n")
            file.flush()
    data = summary([done[seed] for seed in range(FIRST_SEED, FIRST_SEED + cases)], LEAST)
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

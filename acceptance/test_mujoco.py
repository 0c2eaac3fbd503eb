"""What arms of six and seven axes hide in MuJoCo, by its own friction, gears, contacts and motors, found or not.

ROBOT_IDENT_MUJOCO_CASES: cases in all (200). Finished cases are kept
in build/acceptance, so that what was stopped goes on from them.
"""

from __future__ import annotations

import os
from functools import cache, partial
from typing import Any

import pytest
from mujoco_world.run import prepare, run_case
from table import FIRST_SEED, print_rates, rate_of
from trials import judged

ALL = int(os.environ.get("ROBOT_IDENT_MUJOCO_CASES", "200"))
SHARES = {"single": 0.5, "pair": 0.15, "null": 0.15, "unknown": 0.2}


@cache
def outcomes(kind: str) -> dict[str, Any]:
    prepare()
    seeds = range(FIRST_SEED, FIRST_SEED + round(ALL * SHARES[kind]))
    run = partial(run_case, kind=kind)
    data = judged(f"mujoco_{kind}", run, seeds, 0.0)
    print_rates(f"MuJoCo, {kind}", data)
    return data


@pytest.mark.parametrize(
    ("kind", "name", "least"),
    [
        ("single", "named_right", 0.88),
        ("single", "truth_in_tie_group", 0.90),
        ("pair", "pair_found_nothing_else", 0.73),
    ],
)
def test_found_no_less_often_than_before(kind: str, name: str, least: float) -> None:
    """Shares of an earlier procedure on 100 cases; they must lie within the interval that the cases leave."""
    rate = rate_of(outcomes(kind), name)
    assert rate["upper"] >= least, rate


@pytest.mark.parametrize(
    ("kind", "name", "most"), [("null", "false_name_on_null", 0.0), ("unknown", "unknown_named", 0.20)]
)
def test_wrong_no_more_often_than_before(kind: str, name: str, most: float) -> None:
    rate = rate_of(outcomes(kind), name)
    assert rate["lower"] <= most, rate

"""A motor on a bench, simulated by MuJoCo and recorded once: what it hides is named without an option."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from mujoco_world.one_axis import KINDS, OneAxis, run_case

CASES = int(os.environ.get("ROBOT_IDENT_ONE_AXIS_CASES", "24"))
"""Of every kind."""
FIRST = 11200
"""No development has used seeds from here on."""

RIGHT = {"friction_behind_play": 0.5}
"""Share of right names below which something is wrong: a play of a degree looks like presliding at 3 Hz."""
WRONG = {"friction_behind_play": 0.35}


@pytest.fixture(scope="module", params=KINDS)
def outcomes(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[str, list[OneAxis]]:
    kind: str = request.param
    folder: Path = tmp_path_factory.mktemp(kind)
    found = [run_case(seed, kind, folder) for seed in range(FIRST, FIRST + CASES)]
    right, wrong = sum(one.right for one in found), sum(one.wrong for one in found)
    print(f"\none axis, {kind}: right {right} of {CASES}, wrong name {wrong}")
    for one in found:
        if not one.right:
            print(f"  {one.moved}: {', '.join(one.named) or 'nothing named'}")
    return kind, found


def test_named_right(outcomes: tuple[str, list[OneAxis]]) -> None:
    kind, found = outcomes
    assert sum(one.right for one in found) >= RIGHT.get(kind, 0.8) * len(found)


def test_no_wrong_name(outcomes: tuple[str, list[OneAxis]]) -> None:
    kind, found = outcomes
    assert sum(one.wrong for one in found) <= WRONG.get(kind, 0.125) * len(found)

"""Brushing: the same moments everywhere, and shares that are those of `compare`."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from robot_ident.errors import InputError
from robot_ident.workbench.brushing import Condition, Look
from robot_ident.workbench.view import View


@pytest.fixture(scope="module")
def view(bench: Any) -> View:
    return View(bench.session, 0)


def holds(view: View, joint: int, *conditions: Condition) -> Any:
    return Look(view, joint, conditions=conditions).held()


def test_a_region_of_compare_holds_what_compare_says(view: View) -> None:
    regions = [(joint, region) for joint, found in enumerate(view.comparison["joints"]) for region in found["worst"]]
    assert regions
    for joint, region in regions:
        names = [one["name"] for one in view.recordings]
        place = names.index(region["recording"]) if "recording" in region else None
        found = holds(view, joint, Condition(region["what"], region["from"], region["to"], place))
        assert found.share == pytest.approx(region["share"], abs=0.01)
        assert found.of_time == pytest.approx(region["of_time"], abs=0.005)


def test_conditions_hold_together_and_stay_with_their_joint(view: View) -> None:
    slow = Condition("velocity of joint_2", -0.1, 0.1)
    early = Condition("time", 0.0, 6.0, 0)
    from_one, from_three = (Look(view, joint, conditions=[slow, early]).inside for joint in (0, 2))
    assert from_one and from_three
    for one, three in zip(from_one, from_three, strict=True):
        np.testing.assert_array_equal(one, three)
    assert from_one[0].any()
    assert not from_one[1].any()
    assert np.all(np.abs(view.rows[0].dq[from_one[0], 1]) <= 0.1)
    assert np.all(view.rows[0].t[from_one[0]] <= 6.0)


def test_a_forged_region_is_refused(view: View) -> None:
    for forged in ({"variable": "velocity"}, {"variable": "velocity", "lower": "x", "upper": 1}):
        with pytest.raises(InputError, match="no region"):
            Condition.of(forged)
    with pytest.raises(InputError, match="no variable"):
        holds(view, 0, Condition("temperature", 0.0, 1.0))
    with pytest.raises(InputError, match="no joint 'joint_9'"):
        holds(view, 0, Condition("velocity of joint_9", 0.0, 1.0))


def test_all_of_the_time_holds_all_of_the_excess(view: View) -> None:
    joint = view.worst
    found = holds(view, joint, Condition("time", -1.0, 1e9))
    assert (found.share, found.of_time) == (pytest.approx(1.0), pytest.approx(1.0))
    assert found.rms**2 == pytest.approx(view.comparison["joints"][joint]["residual_mse"])

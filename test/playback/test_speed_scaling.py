"""A robot at half speed plays another motion than the one that was certified and is to be identified from."""

from __future__ import annotations

import pytest

from robot_ident.playback.supervisor import SpeedScaling


def test_no_topic_no_doubt() -> None:
    assert SpeedScaling("").problem == ""


def test_a_start_waits_for_a_word() -> None:
    assert SpeedScaling("/speed").problem == "nothing was heard on /speed"


@pytest.mark.parametrize(("heard", "problem"), [
    ([1.0], ""),
    ([100.0], ""),
    ([0.5], "the robot's speed scaling is 0.5"),
    ([50.0], "the robot's speed scaling is 50"),
    ([100.0, 1.0], "the robot's speed scaling is 1"),
    ([1.0, 0.0, 1.0], ""),
])  # fmt: skip
def test_full_speed_is_one_or_a_hundred_but_one_percent_is_not(heard: list[float], problem: str) -> None:
    scaling = SpeedScaling("/speed")
    for value in heard:
        scaling.update(value)
    assert scaling.problem == problem

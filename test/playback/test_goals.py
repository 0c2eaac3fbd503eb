"""What a controller answers: replaced goals end as a matter of course, everything else is trouble."""

from __future__ import annotations

import pytest

from robot_ident.playback.windows import FollowError, Goals, GoalStatus


@pytest.mark.parametrize(
    ("status", "error"),
    [(GoalStatus.CANCELED, FollowError.SUCCESSFUL), (GoalStatus.ABORTED, FollowError.INVALID_GOAL)],
)
def test_a_goal_that_was_replaced_is_given_up_without_a_word(status: int, error: int) -> None:
    goals = Goals()
    first, second = goals.next(0.0), goals.next(0.2)
    assert goals.ended(first, status, error, "cancelled due to new incoming action") == ""
    assert "the controller" in goals.ended(second, status, error), "but the latest isn't"


def test_a_violated_tolerance_is_trouble_whichever_goal_it_was() -> None:
    goals = Goals()
    first, second = goals.next(0.0), goals.next(0.2)
    for number in (first, second):
        text = goals.ended(number, GoalStatus.ABORTED, FollowError.PATH_TOLERANCE_VIOLATED)
        assert text == "the controller aborted the trajectory: PATH_TOLERANCE_VIOLATED"
    assert goals.ended(second, GoalStatus.ABORTED, -9, "joint_2 is stuck").endswith("joint_2 is stuck")


def test_the_end_of_a_motion() -> None:
    goals = Goals()
    assert goals.ended(goals.next(0.0), GoalStatus.SUCCEEDED, FollowError.SUCCESSFUL) == ""


def test_the_latest_goal_canceled_by_another_hand() -> None:
    goals = Goals()
    assert goals.ended(goals.next(0.0), GoalStatus.CANCELED, 0) == (
        "the controller canceled the trajectory: no reason was given"
    )


def test_answers_are_waited_for() -> None:
    goals = Goals()
    assert goals.unanswered(9.0) == 0.0
    first, second = goals.next(1.0), goals.next(1.2)
    assert goals.unanswered(1.5) == pytest.approx(0.5)
    goals.answered(first)
    assert goals.unanswered(1.5) == pytest.approx(0.3)
    goals.answered(second)
    assert goals.unanswered(1.5) == 0.0
    goals.next(2.0)
    goals.forget()
    assert goals.unanswered(9.0) == 0.0

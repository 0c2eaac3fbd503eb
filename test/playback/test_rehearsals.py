"""What goes before a motion: each rehearsal joins the next, and is judged, by itself."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from robot_ident.playback.player import Player
from robot_ident.playback.supervisor import Bounds, Watch
from test.playback.test_player import Quintic, Robot, plan_stop


def with_rehearsals(judge: Callable[[int], str]) -> Player:
    """Two rehearsals, there and back, before the motion."""
    watch = Watch(("a",), Bounds(0.2, np.array([0.1]), np.array([50.0])))
    there, back = Quintic(0.5, 0.0, 1.0), Quintic(0.0, 0.5, 1.0)
    return Player(
        Quintic(0.5, -0.5, 2.0),
        lambda q: Quintic(float(q[0]), 0.5, 1.0),
        plan_stop,
        watch,
        rehearsals=(there, back),
        judge=judge,
    )


def test_a_rehearsal_is_judged_whatever_ticks_are_left_out() -> None:
    asked: list[int] = []
    robot = Robot(with_rehearsals(lambda number: asked.append(number) or ""))
    robot.run(30)
    robot.player.start()
    robot.player.prepare()
    robot.run(238)  # 0.2 s of rest, 1 s of approach, 0.2 s, 1 s there
    assert robot.player.number == 0 and asked == []
    robot.k += 23  # over all of the rest
    robot.run(1)
    assert asked == [0] and robot.player.number == 1
    robot.run(150)
    assert asked == [0, 1]


def test_a_rehearsal_is_judged_by_what_it_did_itself() -> None:
    worst: list[float] = []
    robot = Robot(with_rehearsals(lambda number: worst.append(float(p.watch.worst_tracking[0])) or ""))
    p = robot.player
    robot.run(30)
    p.start()
    p.prepare()
    robot.run(60)
    robot.frozen = True  # it stands for a moment in the approach
    robot.run(20)
    robot.frozen = False
    off = float(p.watch.worst_tracking[0])
    robot.run(300)
    assert off > 0.01 and len(worst) == 2 and max(worst) < 0.2 * off


def test_motions_that_do_not_join_are_refused() -> None:
    watch = Watch(("a",), Bounds(0.2, np.array([0.1]), np.array([50.0])))
    with pytest.raises(ValueError, match="motion 0 ends elsewhere than motion 1 begins"):
        Player(
            Quintic(0.5, -0.5, 2.0),
            lambda q: Quintic(0.0, 0.5, 1.0),
            plan_stop,
            watch,
            rehearsals=[Quintic(0.5, 0.4, 1.0)],
        )

"""What a controller is sent ahead of time: it follows the plan, ends at rest, and a stop never makes a step."""

from __future__ import annotations

import numpy as np
import pytest

from robot_ident.playback.player import Phase, Player
from robot_ident.playback.supervisor import Bounds, Watch
from robot_ident.playback.windows import Window, WindowSchedule
from robot_ident.signals.motion import Array, Motion
from robot_ident.testbed.real_time import TrajectoryFollower
from test.playback.test_player import DT, Quintic, plan_stop

LEAD = 0.1


def player(**options: object) -> Player:
    watch = Watch(("a",), Bounds(0.2, np.array([0.1]), np.array([50.0])))
    whole = Quintic(0.5, 0.5 - 1e-6, 0.4)  # a rehearsal that hardly moves
    return Player(
        Quintic(0.5 - 1e-6, -0.5, 2.0),
        lambda q: Quintic(float(q[0]), 0.5, 1.0),
        plan_stop,
        watch,
        lead=LEAD,
        dwell=0.5,
        rehearsals=[whole],
        **options,  # type: ignore[arg-type]
    )


class Controlled:
    """A robot whose controller takes windows in `latency` seconds late; the sender reckons with `late` seconds."""

    def __init__(self, p: Player, latency: float = 0.04, late: float = 0.0) -> None:
        self.player, self.k, self.latency = p, 0, latency
        self.follower = TrajectoryFollower(1)
        self.late, self.silent = late, False
        self.schedule = WindowSchedule(
            plan_stop, lambda: round(1e9 * self.late), lead=LEAD, every=0.05, ahead=0.4, latest=0.2
        )
        self.motions: list[Motion] = []
        self.deaf = False
        self._coming: list[tuple[float, Array, Motion]] = []

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / DT)):
            t = self.k * DT
            state = self.follower.at(np.array([t]))
            if not self.silent:
                self.player.watch.update(("a",), state.q[0], [1.0], (self.k + 1) * 10_000_000, t)
            self.player.tick(t, t)
            window = self.schedule.due(self.player, t, 0)
            if window is not None and not self.deaf:
                assert not window.motion.dq[-1].any() and np.all(np.diff(window.t) > 0)
                self._coming.append((t + self.latency, t + window.t, window.motion))
            for due, times, motion in [entry for entry in self._coming if entry[0] <= t]:
                self.follower.take(due, times, motion)
            self._coming = [entry for entry in self._coming if entry[0] > t]
            self.motions.append(self.follower.at(t + DT * np.arange(5) / 5))
            self.k += 1

    def smooth(self) -> None:
        q, dq = (np.concatenate([getattr(m, name)[:, 0] for m in self.motions]) for name in ("q", "dq"))
        assert np.abs(np.diff(dq)).max() < 0.05
        np.testing.assert_allclose(np.diff(q) / (DT / 5), 0.5 * (dq[1:] + dq[:-1]), atol=0.01)


def started(p: Player, latency: float = 0.04, late: float = 0.0) -> Controlled:
    robot = Controlled(p, latency, late)
    robot.run(0.3)
    assert p.start() == ""
    p.prepare()
    return robot


def test_a_whole_motion_through_a_controller() -> None:
    p = player()
    robot = started(p)
    robot.run(6.0)
    assert p.phase is Phase.HOLDING and p.completed == 1
    assert robot.follower.at(np.array([10.0])).q[0, 0] == pytest.approx(-0.5)
    robot.smooth()


@pytest.mark.parametrize("after", [0.35, 0.9, 2.2, 3.0, 3.7, 4.3])
def test_a_stop_diverges_only_from_what_is_still_ahead(after: float) -> None:
    p = player()
    robot = started(p)
    robot.run(after)
    p.stop("stopped by hand")
    robot.run(2.0)
    assert p.phase is Phase.HOLDING
    robot.smooth()
    assert not robot.motions[-1].dq.any()


def test_the_way_to_the_start_is_told_long_before_it_begins() -> None:
    """However late what goes on comes: only what changes must come before it takes effect."""
    p = player()
    robot = started(p, latency=0.3)
    robot.run(6.0)
    assert p.phase is Phase.HOLDING and p.completed == 1
    robot.smooth()


def test_a_stop_that_would_come_too_late_is_not_sent() -> None:
    """The controller comes to rest by itself, at the end of what it was told before, and does not leap."""
    p = player()
    robot = started(p, late=0.09, latency=0.2)
    robot.run(3.4)
    p.stop("stopped by hand")
    robot.run(2.0)
    assert p.phase is Phase.HALTED and p.fault
    assert p.reason == "stopped by hand; a stop came 0.090 s late: the controller stops by itself"
    assert not robot.motions[-1].dq.any()
    robot.smooth()


def test_a_controller_that_hears_nothing_more_rests() -> None:
    robot = started(player())
    robot.run(3.4)
    assert abs(robot.motions[-1].dq[-1, 0]) > 0.3
    robot.deaf = True
    robot.run(1.5)
    assert not robot.motions[-1].dq.any()
    robot.smooth()


def test_a_rehearsal_that_is_not_good_enough_ends_the_play() -> None:
    p = player(judge=lambda number: f"rehearsal {number} was rough")
    robot = started(p)
    robot.run(4.0)
    assert p.phase is Phase.HOLDING and p.fault and p.reason == "rehearsal 0 was rough" and p.completed == 0
    assert robot.motions[-1].q[-1, 0] == pytest.approx(0.5, abs=1e-5)
    robot.smooth()


@pytest.mark.parametrize("deaf", [False, True])
def test_a_robot_of_which_nothing_is_heard_stops_by_itself(deaf: bool) -> None:
    """It may hear nothing either, and then a stop of which it heard late would be another than its own."""
    p = player()
    robot = started(p)
    robot.run(3.4)
    robot.silent, robot.deaf = True, deaf
    robot.run(1.0)
    assert p.phase is Phase.HALTED and p.fault
    assert p.reason.startswith("no new joint_states for 0.2") and p.reason.endswith("the controller stops by itself")
    robot.silent = robot.deaf = False
    robot.run(1.0)
    assert not robot.motions[-1].dq.any()
    robot.smooth()


@pytest.mark.parametrize("late", [0.3, -5.0])
def test_what_goes_on_is_not_sent_too_late_nor_by_a_clock_that_was_set(late: float) -> None:
    p = player()
    robot = started(p)
    robot.run(3.4)
    robot.late = late
    robot.run(1.5)
    assert p.phase is Phase.HALTED
    assert p.reason == f"commands came {late:+.3f} s late: the controller stops by itself"
    assert not robot.motions[-1].dq.any()
    robot.smooth()


def test_a_hold_needs_no_window() -> None:
    """The last one of a motion has ended at rest; one after it could reach a controller that has rested elsewhere."""
    p = player()
    robot = started(p)
    sent: list[Phase] = []
    due = robot.schedule.due

    def noted(player: Player, t: float, stamp: int) -> Window | None:
        window = due(player, t, stamp)
        if window is not None:
            sent.append(player.phase)
        return window

    robot.schedule.due = noted  # type: ignore[method-assign]
    robot.run(6.0)
    assert p.phase is Phase.HOLDING and set(sent) == {Phase.APPROACH, Phase.PLAYING}
    assert robot.follower.at(np.array([10.0])).q[0, 0] == pytest.approx(-0.5)

"""The phases of a motion: whatever happens, position and velocity of the commands never step."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from robot_ident.playback.plan import Slowed
from robot_ident.playback.player import Phase, Player
from robot_ident.playback.supervisor import Bounds, Watch
from robot_ident.signals.motion import Array, Motion

DT = 0.01


@dataclass(frozen=True)
class Quintic:
    """One joint from `start` (with a velocity) to a goal at rest: minimum jerk."""

    start: float
    goal: float
    length: float
    velocity: float = 0.0
    acceleration: float = 0.0

    @property
    def duration(self) -> float:
        return self.length

    @property
    def start_pose(self) -> Array:
        return np.array([self.start])

    def reference(self, t: Array) -> Motion:
        end = self.length
        powers = np.array(
            [
                [end**k for k in (3, 4, 5)],
                [k * end ** (k - 1) for k in (3, 4, 5)],
                [k * (k - 1) * end ** (k - 2) for k in (3, 4, 5)],
            ]
        )
        known = np.array([self.start, self.velocity, 0.5 * self.acceleration])
        at_end = np.array([known @ [1, end, end**2], known @ [0, 1, 2 * end], 2 * known[2]])
        c = np.concatenate([known, np.linalg.solve(powers, np.array([self.goal, 0.0, 0.0]) - at_end)])
        p = np.polynomial.Polynomial(c)
        return Motion(*(f(t)[:, None] for f in (p, p.deriv(), p.deriv(2))))


def plan_stop(motion: Motion) -> Quintic:
    q, dq, ddq = motion.q[0, 0], motion.dq[0, 0], motion.ddq[0, 0]
    return Quintic(q, q + 0.2 * dq, 0.5, dq, ddq)


def player(duration: float = 2.0, **more: Any) -> Player:
    watch = Watch(("a",), Bounds(0.2, np.array([0.1]), np.array([50.0])))
    return Player(Quintic(0.5, -0.5, duration), lambda q: Quintic(float(q[0]), 0.5, 1.0), plan_stop, watch, **more)


class Robot:
    """Follows the commands exactly, unless it is told to be silent or to stand."""

    def __init__(self, p: Player, q: float = 0.0) -> None:
        self.player, self.q, self.k = p, q, 0
        self.silent = self.frozen = False
        self.commands: list[Motion | None] = []

    def run(self, steps: int) -> None:
        for _ in range(steps):
            now = self.k * DT
            if not self.silent:
                self.player.watch.update(("a",), [self.q], [1.0], (self.k + 1) * 10_000_000, now)
            command = self.player.tick(now, now)
            self.commands.append(command)
            if command is not None and not self.frozen:
                self.q = float(command.q[0, 0])
            self.k += 1

    def smooth(self) -> None:
        """The commands never step, and say the velocity that they have."""
        sent = [c for c in self.commands if c is not None]
        q, dq = np.array([c.q[0, 0] for c in sent]), np.array([c.dq[0, 0] for c in sent])
        assert np.abs(np.diff(q)).max() < 0.05 * np.abs(q).max()
        assert np.abs(np.diff(dq)).max() < 0.2
        mean = 0.5 * (dq[1:] + dq[:-1])
        np.testing.assert_allclose(np.diff(q) / DT, mean, atol=0.02)


def started(duration: float = 2.0) -> Robot:
    robot = Robot(player(duration))
    robot.run(30)
    assert robot.player.start() == ""
    robot.player.prepare()
    return robot


def test_nothing_is_commanded_before_the_start() -> None:
    robot = Robot(player())
    robot.run(50)
    assert robot.commands == [None] * 50
    assert robot.player.phase is Phase.IDLE


def test_a_whole_motion() -> None:
    robot = started()
    robot.run(450)
    p = robot.player
    assert p.phase is Phase.HOLDING and p.completed == 1 and not p.fault
    assert robot.q == pytest.approx(-0.5)
    robot.smooth()
    phases = [c for c in robot.commands[-50:] if c is not None]
    assert len(phases) == 50 and all(c.dq[0, 0] == 0.0 for c in phases), "the last position is held"


def test_a_second_run_begins_from_the_held_position() -> None:
    robot = started()
    robot.run(450)
    assert robot.player.start() == ""
    robot.run(20)
    assert robot.commands[-1] is not None, "it holds while the approach is planned"
    robot.player.prepare()
    robot.run(450)
    assert robot.player.completed == 2
    robot.smooth()


def test_start_while_moving_is_refused() -> None:
    robot = started()
    robot.run(20)
    assert robot.player.start() == "already approaching"


@pytest.mark.parametrize("after", [50, 130, 200, 300])
def test_stop_at_any_time_is_smooth(after: int) -> None:
    robot = started()
    robot.run(after)
    robot.player.stop("stopped by hand")
    robot.run(1)
    assert robot.player.phase is Phase.STOPPING and robot.player.stop_duration == 0.5
    robot.run(100)
    assert robot.player.phase is Phase.HOLDING and robot.player.reason == "stopped by hand"
    assert robot.player.stop_duration == 0.0
    assert not robot.player.fault and robot.player.completed == 0
    robot.smooth()


def test_a_silent_robot_is_stopped_smoothly() -> None:
    robot = started()
    robot.run(200)
    robot.silent = True
    robot.run(100)
    assert robot.player.fault
    assert "no new joint_states" in robot.player.reason
    sent = [c for c in robot.commands if c is not None]
    assert not sent[-1].dq.any(), "it was brought to rest first"
    assert robot.player.phase is Phase.HALTED, "nobody knows where the robot is: nothing is commanded to it"
    robot.smooth()


@pytest.mark.parametrize("asked", [False, True])
@pytest.mark.parametrize("how", ["silent", "moved"])
def test_a_hold_ends_when_the_robot_is_not_seen_there(how: str, asked: bool) -> None:
    """An arm that was off or moved by hand would leap to the held position, a further start waiting or not."""
    robot = started()
    robot.run(450)
    assert robot.player.phase is Phase.HOLDING and not robot.player.fault
    assert not asked or robot.player.start() == ""
    robot.silent, robot.frozen = how == "silent", True
    robot.q += 0.0 if how == "silent" else 0.2
    robot.run(40)
    assert robot.player.phase is Phase.HALTED and robot.player.fault
    assert ("no new joint_states" if how == "silent" else "from where it was sent") in robot.player.reason
    assert robot.commands[-5:] == [None] * 5
    robot.silent = robot.frozen = False
    robot.run(40)
    assert robot.player.start() == "", "it starts again from where the robot is"
    robot.player.prepare()
    robot.run(450)
    assert robot.player.phase is Phase.HOLDING and robot.player.completed == 2 and not robot.player.fault


def test_a_robot_that_does_not_follow_is_stopped_smoothly() -> None:
    robot = started(1.0)
    robot.run(130)
    robot.frozen = True
    robot.run(150)
    assert robot.player.fault and "from where it was sent" in robot.player.reason
    robot.smooth()


def test_nan_stops() -> None:
    robot = started()
    robot.run(200)
    robot.player.watch.update(("a",), [float("nan")], [1.0], 10**12, robot.k * DT)
    robot.run(2)
    assert robot.player.phase is Phase.STOPPING and "nan" in robot.player.reason
    robot.run(100)
    robot.smooth()


def test_after_a_halt_nothing_is_commanded() -> None:
    robot = started()
    robot.run(200)
    robot.player.halt("this process stood still")
    robot.run(50)
    assert robot.commands[-50:] == [None] * 50
    assert robot.player.phase is Phase.HALTED and robot.player.fault
    robot.player.watch.clear()
    assert robot.player.start() == "", "it may start again, from where the robot stands"
    robot.player.prepare()
    robot.run(450)
    assert robot.player.completed == 1 and not robot.player.fault


def test_a_stall_while_nothing_has_been_commanded_is_harmless() -> None:
    robot = Robot(player())
    robot.run(30)
    robot.player.start()
    robot.player.halt("this process stood still")
    assert robot.player.phase is Phase.PREPARING
    robot.player.prepare()
    robot.run(450)
    assert robot.player.completed == 1 and not robot.player.fault


def test_what_was_planned_before_a_stall_is_planned_anew() -> None:
    """The robot may have been moved meanwhile, and what it told is forgotten."""
    robot = started()
    assert not robot.player.unplanned
    robot.player.halt("this process stood still")
    robot.player.watch.forget()
    robot.silent = True
    robot.run(20)
    assert robot.player.phase is Phase.PREPARING and robot.player.unplanned
    assert robot.commands[-20:] == [None] * 20
    robot.silent, robot.q = False, 0.2
    robot.run(20)
    robot.player.prepare()
    robot.run(450)
    assert robot.player.completed == 1 and not robot.player.fault
    robot.smooth()


def test_a_stall_while_the_approach_is_planned() -> None:
    """What was begun before it ended counts no more."""
    robot = Robot(player())
    robot.run(30)

    def interrupted(q: Array) -> Quintic:
        p.halt("this process stood still")
        return Quintic(float(q[0]), 0.5, 1.0)

    p = Player(Quintic(0.5, -0.5, 1.0), interrupted, plan_stop, robot.player.watch)
    p.start()
    p.prepare()
    assert p.unplanned


def test_a_hindrance_is_what_a_start_waits_for() -> None:
    """A speed slider below 100 %, told again and again: it ends no start, and nothing moves before it is gone."""
    slider = ["slow"]
    robot = Robot(player(hindrance=lambda: slider[0]))
    robot.run(30)
    assert robot.player.start() == ""
    for _ in range(3):
        robot.player.prepare()
        robot.player.interrupt("slow")
        robot.run(1)
        assert robot.player.phase is Phase.PREPARING and robot.player.unplanned and not robot.player.fault
    assert robot.commands == [None] * 33
    slider[0] = ""
    robot.player.prepare()
    robot.run(1)
    assert robot.player.phase is Phase.APPROACH


@pytest.mark.parametrize("after", [50, 200])
def test_an_interruption_stops_what_moves_as_a_fault(after: int) -> None:
    robot = started()
    robot.run(after)
    for _ in range(100):
        robot.player.interrupt("slow")
        robot.run(1)
    assert robot.player.phase is Phase.HOLDING and robot.player.fault and robot.player.reason == "slow"
    robot.smooth()
    assert robot.player.start() == "", "and the next start waits again"
    robot.player.interrupt("slow")
    assert robot.player.phase is Phase.PREPARING and not robot.player.fault


def test_a_start_can_be_cancelled_and_a_plan_can_fail() -> None:
    robot = Robot(player())
    robot.run(30)
    robot.player.start()
    robot.player.stop("no")
    assert robot.player.phase is Phase.IDLE and robot.player.reason == "no"

    def no_way(q: Array) -> Quintic:
        raise ValueError("no way")

    broken = Player(Quintic(0.5, -0.5, 1.0), no_way, plan_stop, robot.player.watch)
    broken.start()
    with pytest.raises(ValueError, match="no way"):
        broken.prepare()
    assert broken.phase is Phase.IDLE


def test_a_skipped_tick_keeps_the_time() -> None:
    robot = started()
    robot.run(200)
    before = robot.player.elapsed
    robot.k += 5
    robot.run(1)
    assert robot.player.elapsed == pytest.approx(before + 6 * DT)


def test_slowed_keeps_the_path() -> None:
    original = Quintic(0.5, -0.5, 2.0)
    slow = Slowed(original, 0.25)
    t = np.linspace(0.0, 8.0, 400)
    motion = slow.reference(t)
    assert slow.duration == 8.0
    np.testing.assert_array_equal(motion.q, original.reference(t * 0.25).q)
    np.testing.assert_allclose(np.gradient(motion.q[:, 0], t)[1:-1], motion.dq[1:-1, 0], atol=1e-4)
    np.testing.assert_allclose(np.gradient(motion.dq[:, 0], t)[1:-1], motion.ddq[1:-1, 0], atol=1e-3)


@pytest.mark.parametrize("how", ["silent", "moved"])
def test_a_robot_that_goes_elsewhere_while_its_approach_is_planned(how: str) -> None:
    """Nothing is commanded from a place that the robot has left; the approach is planned anew from where it is."""
    robot = started()
    robot.silent, robot.q = how == "silent", 0.3
    robot.k += 30
    robot.run(1)
    assert robot.player.phase is Phase.PREPARING and robot.player.unplanned and robot.commands[-1] is None
    robot.silent = False
    robot.run(25)
    robot.player.prepare()
    robot.run(450)
    assert robot.player.completed == 1 and not robot.player.fault
    robot.smooth()


def test_nothing_is_planned_for_a_robot_that_nothing_is_known_of() -> None:
    p = player()
    assert p.start() == ""
    p.prepare()
    assert p.unplanned


def test_a_command_far_from_the_last_one_is_not_sent() -> None:
    """Where ticks are left out at speed, a robot would leap by what it should have gone meanwhile."""
    watch = Watch(("a",), Bounds(0.2, np.array([0.1]), np.array([50.0])))
    p = Player(
        Quintic(0.5, -0.5, 1.0),
        lambda q: Quintic(float(q[0]), 0.5, 1.0),
        plan_stop,
        watch,
        longest_step=np.array([0.05]),
    )
    robot = Robot(p)
    robot.run(30)
    p.start()
    p.prepare()
    robot.run(190)
    assert p.phase is Phase.PLAYING
    robot.k += 4
    robot.run(1)
    assert p.phase is Phase.PLAYING, "a bound on tracking of 0.1 rad allows for that"
    robot.k += 9
    robot.run(1)
    assert p.phase is Phase.HALTED and p.fault and robot.commands[-1] is None
    assert "a would leap by 0.1" in p.reason and p.reason.endswith("this process was held up")

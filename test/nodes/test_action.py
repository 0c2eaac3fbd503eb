"""FollowJointTrajectory: goals, answers and trouble, on stand-ins for what no wheel has: control_msgs and a server."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rclpy")

from robot_ident.errors import InputError  # noqa: E402
from robot_ident.nodes import outputs  # noqa: E402
from robot_ident.playback.player import Phase, Player  # noqa: E402
from robot_ident.playback.supervisor import Bounds, Watch  # noqa: E402
from robot_ident.signals.motion import Array, Motion  # noqa: E402

JOINTS = ("a", "b")


@dataclass
class Later:
    """A future that the test brings about."""

    callbacks: list[Callable[[Any], None]] = field(default_factory=list)

    def add_done_callback(self, callback: Callable[[Any], None]) -> None:
        self.callbacks.append(callback)

    def bring(self, result: Any) -> None:
        for callback in self.callbacks:
            callback(SimpleNamespace(result=lambda: result))


class Client:
    """Takes goals and keeps them; the test answers."""

    made: Client

    def __init__(self, node: Any, kind: Any, name: str) -> None:
        self.name, self.goals, self.answers = name, [], []
        self.results: list[Later] = []
        self.ready, self.prompt = False, True
        Client.made = self

    def server_is_ready(self) -> bool:
        return self.ready

    def send_goal_async(self, goal: Any) -> Later:
        self.goals.append(goal)
        self.answers.append(Later())
        return self.answers[-1]

    def answer(self) -> None:
        """Accept what was sent since the last time; `results` are the futures of how it ends."""
        for answer in self.answers[len(self.results) :] if self.prompt else ():
            self.results.append(later := Later())
            answer.bring(SimpleNamespace(accepted=True, get_result_async=lambda later=later: later))


@dataclass(frozen=True)
class Way:
    """A gentle way from one place to another and rest."""

    start: float
    goal: float
    duration: float = 2.0

    @property
    def start_pose(self) -> Array:
        return np.full(2, self.start)

    def reference(self, t: Array) -> Motion:
        s = np.clip(np.asarray(t, dtype=float) / self.duration, 0.0, 1.0)[:, None] * np.ones(2)
        way, T = self.goal - self.start, self.duration
        q = self.start + way * s**3 * (10 - 15 * s + 6 * s * s)
        return Motion(q, way / T * 30 * (s - s * s) ** 2, way / T**2 * 60 * (s - 3 * s * s + 2 * s**3))


def plan_stop(motion: Motion) -> Way:
    return Way(float(motion.q[0, 0]), float(motion.q[0, 0]) + 0.1 * float(motion.dq[0, 0]), 0.3)


@pytest.fixture
def troubles(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    module = ModuleType("control_msgs.action")
    kind = SimpleNamespace(Goal=lambda trajectory: SimpleNamespace(trajectory=trajectory))
    module.FollowJointTrajectory = kind  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "control_msgs", ModuleType("control_msgs"))
    monkeypatch.setitem(sys.modules, "control_msgs.action", module)
    monkeypatch.setattr(outputs, "ActionClient", Client)
    return []


@pytest.fixture
def scene(troubles: list[str]) -> tuple[outputs.ActionOutput, Client, Callable[[float], Player]]:
    """Return the output, its client, and a function that plays for so long from the start on."""
    clock = [0]
    node: Any = SimpleNamespace(now_ns=lambda: clock[0])
    output = outputs.ActionOutput(node, JOINTS, "/arm/", plan_stop, troubles.append)
    watch = Watch(JOINTS, Bounds(10.0, np.full(2, 10.0), np.full(2, 1e9)))
    player = Player(Way(0.5, -0.5), lambda q: Way(float(q[0]), 0.5), plan_stop, watch, lead=output.lead)

    def play(seconds: float) -> Player:
        for k in range(round(seconds * 100)):
            watch.update(JOINTS, [0.0, 0.0], [], (k + 1) * 10_000_000, 0.01 * k)
            if k == 30:
                assert player.start() == ""
                player.prepare()
            clock[0] = 10**9 + k * 10**7
            output.send(player, player.tick(0.01 * k, 0.01 * k), 0.01 * k, node.now_ns)
            Client.made.answer()
        return player

    return output, Client.made, play


def test_without_control_msgs(start: Callable[..., Any], trajectory: Path) -> None:
    with pytest.raises(InputError, match="ros-jazzy-control-msgs"):
        outputs.follow_joint_trajectory()
    publisher = start(
        "trajectory_publisher", trajectory=trajectory, output="follow_joint_trajectory", controller="/arm_controller"
    )
    assert publisher.wait() == 2
    assert "output joint_trajectory drives the same controller" in publisher.text
    assert "Traceback" not in publisher.text


def test_each_goal_ends_at_rest_and_the_row_covers_the_motion(scene: Any) -> None:
    output, client, play = scene
    assert client.name == "/arm/follow_joint_trajectory"
    assert output.not_heard() == "nobody serves the action /arm/follow_joint_trajectory"
    client.ready = True
    assert output.not_heard() == "" and output.rival() == "" and not output.simulated()
    player = play(6.0)
    assert player.phase is Phase.HOLDING and player.completed == 1
    assert 4 * 4 <= len(client.goals) <= 4 * 6
    for goal in client.goals:
        message = goal.trajectory
        assert list(message.joint_names) == list(JOINTS)
        assert not any(message.points[-1].velocities) and not any(message.points[-1].accelerations)
        since = [p.time_from_start.sec + 1e-9 * p.time_from_start.nanosec for p in message.points]
        assert since[0] == 0.0 and np.all(np.diff(since) > 0.0)
    assert client.goals[-1].trajectory.points[-1].positions[0] == pytest.approx(-0.5)


def test_trouble_is_told_once_it_is_one(scene: Any, troubles: list[str]) -> None:
    _, client, play = scene
    play(1.0)
    assert len(ends := client.results) == len(client.goals) > 2
    for end in ends[:-1]:
        end.bring(SimpleNamespace(status=5, result=SimpleNamespace(error_code=-1, error_string="a new one came")))
    assert troubles == [], "each was replaced by the next"
    ends[-1].bring(SimpleNamespace(status=6, result=SimpleNamespace(error_code=-4, error_string="")))
    assert troubles == ["the controller aborted the trajectory: PATH_TOLERANCE_VIOLATED"]


def test_a_rejected_goal_is_trouble(scene: Any, troubles: list[str]) -> None:
    _, client, play = scene
    client.prompt = False
    play(0.5)
    client.answers[-1].bring(SimpleNamespace(accepted=False))
    assert troubles == ["the controller rejected the trajectory"]


def test_a_controller_that_answers_no_more_is_sent_nothing_more(scene: Any) -> None:
    """It may have begun to stop by itself, and would leap onto what it heard later."""
    _, client, play = scene
    client.prompt = False
    player = play(4.0)
    assert player.phase is Phase.HALTED and player.fault
    assert player.reason.startswith("the controller has not answered a goal for 0.5")
    assert len(client.goals) <= 3

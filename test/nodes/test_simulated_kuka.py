"""The simulated robot falls behind: what was commanded meanwhile is left out, and it is where it is sent again."""

from __future__ import annotations

import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from processes import write_trajectory

pytest.importorskip("rclpy")

DELAY, PERIOD, LAG = 0.2, 1 / 150, 0.1  # s


@pytest.mark.long
def test_a_robot_that_stood_still_is_not_late_ever_after(
    start: Callable[..., Any], client: Any, until: Callable[..., Any], tmp_path: Path
) -> None:
    """Stopped for 2.8 s of simulated time in which the commands go on."""
    from sensor_msgs.msg import JointState

    heard: dict[str, list[tuple[float, list[float]]]] = {"joint_states": [], "joint_command": []}

    def hear(topic: str) -> Callable[[Any], None]:
        return lambda m: heard[topic].append((m.header.stamp.sec + 1e-9 * m.header.stamp.nanosec, list(m.position)))

    for topic in heard:
        client.create_subscription(JointState, topic, hear(topic), 5000)
    states, commands = heard["joint_states"], heard["joint_command"]
    simulated = {"use_sim_time": True}
    start("simulated_clock", speed=2.0, patience=0.1)
    robot = start("simulated_kuka", delay=DELAY, noise=0.0, **simulated)
    patient = {"state_timeout": 10.0, "tracking_error": "[10.0]", "effort_limit": 0.0}
    motion = {"trajectory": write_trajectory(tmp_path / "slow.yaml", 0.3), "periods": 200, "autostart": True}
    publisher = start("trajectory_publisher", **motion, **patient, **simulated)
    publisher.says("playing")
    before = len(commands)
    assert until(lambda: len(commands) > before + 300)
    robot.freeze(lambda: len(commands))
    stopped = len(commands)
    assert until(lambda: len(commands) > stopped + 420)
    robot.send(signal.SIGCONT)
    robot.says("s behind")
    freed = len(states)

    def distance() -> float:
        """Return how far its states of the last second [rad] are from what was sent, at most LAG late."""
        rows = [row for row in states[max(freed, len(states) - 1000) :] if row[0] > states[-1][0] - 1.0]
        if len(rows) < 100:
            return np.inf
        t, q = (np.array(part) for part in zip(*rows, strict=True))
        sent, goal = (np.array(part) for part in zip(*commands[-1000:], strict=True))  # asked at every message: no more
        moves = np.ptp(q, axis=0).max() > 0.3
        lags = DELAY + np.arange(PERIOD, LAG + 2 * PERIOD, PERIOD / 2)
        asked = [np.column_stack([np.interp(t - lag, sent, column) for column in goal.T]) for lag in lags]
        return float(min(np.abs(q - one).max() for one in asked)) if moves else np.inf

    # a loaded machine may delay commands now and then, and what was late may wait for as long as LAG, but not for good
    assert until(lambda: distance() < 0.02), (distance(), len(states) - freed, len(commands) - stopped, robot.text)
    assert "stopping" not in publisher.text and publisher.end()[0] == 0 and robot.end()[0] == 0


@pytest.mark.long
def test_commands_that_came_before_a_reset_go_with_it(
    start: Callable[..., Any], client: Any, call: Callable[..., Any], until: Callable[..., Any]
) -> None:
    """Twice a second it looks for commands; what it finds together with a reset is older than that."""
    from sensor_msgs.msg import JointState
    from std_srvs.srv import Trigger

    joints, away = ["joint_1", "joint_2", "joint_3"], 0.3
    states: list[float] = []
    client.create_subscription(JointState, "joint_states", lambda m: states.append(max(map(abs, m.position))), 100)
    command = client.create_publisher(JointState, "joint_command", 10)
    robot = start("simulated_kuka", rate=2.0, delay=0.0, noise=0.0)

    def send() -> None:
        message = JointState(name=joints, position=[away] * 3, velocity=[0.0] * 3)
        message.header.stamp = client.get_clock().now().to_msg()
        command.publish(message)

    assert until(lambda: command.get_subscription_count() == 1 and states)
    send()
    assert until(lambda: states[-1] > 0.9 * away), "a command is followed"
    assert call(Trigger, "/simulated_kuka/reset").success  # the service is known from now on
    assert until(lambda: states[-1] < 1e-3)
    seen = len(states)
    assert until(lambda: len(states) > seen)
    send()
    assert call(Trigger, "/simulated_kuka/reset").success
    seen = len(states)
    assert until(lambda: len(states) >= seen + 4)
    assert max(states[seen:]) < 1e-3
    assert robot.end()[0] == 0

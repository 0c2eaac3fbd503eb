"""Trajectories for a joint trajectory controller, rehearsals, speed scaling; what is refused on hardware."""

from __future__ import annotations

import signal
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rclpy")

from robot_ident.bags import read_recording  # noqa: E402
from robot_ident.robot import load_robot  # noqa: E402

AT_REST = 5e-3  # rad/s; single velocities scatter by two fifths of it
SIMULATED = {"use_sim_time": True}
PATIENT = {"state_timeout": 4.0, "stall": 4.0, "tracking_error": "[0.3]"}


@pytest.fixture
def driven(start: Callable[..., Any], trajectory: Path, tmp_path: Path) -> Callable[..., tuple[Any, Any, Any]]:
    """Return a function that starts recorder, a robot behind a controller, and the publisher that drives it."""

    def begin(**values: object) -> tuple[Any, Any, Any]:
        start("simulated_clock", speed=2.0, controller="/arm_controller")
        recorder = start("recorder", output=tmp_path / "bag", **SIMULATED)
        robot = start(
            "simulated_kuka", controller="/arm_controller", noise=0.0, initial_position="[0.2,0.0,-0.2]", **SIMULATED
        )
        recorder.says("recording to")
        output = {"output": "joint_trajectory", "controller": "/arm_controller", "autostart": True}
        usual = {"trajectory": trajectory, "exit_when_done": True, "hold_time": 0.2}
        return recorder, robot, start("trajectory_publisher", **{**usual, **output, **PATIENT, **SIMULATED, **values})

    return begin


def smooth_states(bag: Path) -> Any:
    """Return the recorded velocities; the robot never jerks: they change about as slowly as its limits ask.

    The servo adds to the reference's acceleration where friction reverses, by up to a third. A reference that stopped
    without a path would ask the servo for 2 w dq, w = 2 pi 8 Hz: thirty times the limit at 1 rad/s.
    """
    recording = read_recording(bag)
    limits, dq = load_robot().limits, recording.dq
    assert dq is not None
    steps = np.abs(np.diff(dq, axis=0)) / np.diff(recording.t)[:, None]
    assert np.all(steps < 2.0 * limits.acceleration), steps.max(axis=0)
    return dq


def rests_at_end(dq: Any) -> bool:
    """Return whether velocities [N, n] end at rest: the mean of the last ten, since one of them is mostly noise."""
    return bool(np.abs(dq[-10:].mean(axis=0)).max() < AT_REST)


def test_a_rehearsal_and_a_motion_through_a_controller(driven: Callable[..., Any], tmp_path: Path) -> None:
    recorder, robot, publisher = driven(periods=2, rehearsal="[0.5]")
    assert publisher.wait() == 0, publisher.text
    assert "rehearsal at 50% used" in publisher.text
    assert recorder.end()[0] == 0 and robot.end()[0] == 0
    assert "refused" not in robot.text
    dq = smooth_states(tmp_path / "bag")
    assert np.abs(dq).max() > 0.1 and rests_at_end(dq)


def test_a_killed_publisher_leaves_a_robot_that_rests(
    driven: Callable[..., Any], client: Any, until: Callable[..., Any], tmp_path: Path
) -> None:
    from sensor_msgs.msg import JointState

    recorder, robot, publisher = driven(periods=50)
    seen: deque[float] = deque(maxlen=75)  # half a second of the robot's states
    client.create_subscription(
        JointState, "joint_states", lambda it: seen.append(float(np.abs(it.velocity).max())), 100
    )
    publisher.says("playing")
    assert until(lambda: max(seen, default=0.0) > 0.05)
    publisher.end(signal.SIGKILL)
    assert until(lambda: len(seen) == 75 and max(seen) < AT_REST), max(seen)
    assert recorder.end()[0] == 0 and robot.end()[0] == 0
    dq = smooth_states(tmp_path / "bag")
    assert np.abs(dq).max() > 0.05 and rests_at_end(dq)


@pytest.mark.long
def test_a_rough_rehearsal_ends_the_play(driven: Callable[..., Any], tmp_path: Path) -> None:
    recorder, robot, publisher = driven(periods=2, rehearsal="[0.5]", rehearsal_margin=0.01, effort_limit=5.0)
    assert publisher.wait() == 3, publisher.text
    assert "(rehearsal_margin 0.01)" in publisher.text
    assert recorder.end()[0] == 0 and robot.end()[0] == 0
    assert rests_at_end(smooth_states(tmp_path / "bag"))


class Slider:
    """A robot's speed slider: it tells `value`, in percent, a hundred times a second, as the driver of a UR does."""

    def __init__(self, client: Any, value: float) -> None:
        from std_msgs.msg import Float64

        self.value = value
        self.topic = client.create_publisher(Float64, "/speed_scaling", 10)
        client.create_timer(0.01, lambda: self.topic.publish(Float64(data=self.value)))


@pytest.mark.long
def test_a_start_waits_for_full_speed_and_a_motion_stops_below_it(
    driven: Callable[..., Any], client: Any, call: Callable[..., Any], until: Callable[..., Any]
) -> None:
    from std_srvs.srv import Trigger

    slider = Slider(client, 50.0)
    by_hand = {"autostart": False, "hold_time": 300.0, "state_wait": 300.0}
    _, robot, publisher = driven(periods=50, speed_scaling_topic="/speed_scaling", **by_hand)
    assert until(lambda: slider.topic.get_subscription_count() == 1)
    assert call(Trigger, "/trajectory_publisher/start").success
    publisher.says("preparing")
    assert not until(lambda: publisher.text.split("preparing")[1].strip(), 6.0), "half speed is waited out in silence"
    slider.value = 100.0
    publisher.says("playing")
    slider.value = 0.5
    publisher.says("the robot's speed scaling is 0.5")
    rested = ("holding: ", "halted: ")  # halted where this machine was held up: the controller stops by itself
    assert until(lambda: any(phase in publisher.text for phase in rested))
    assert call(Trigger, "/trajectory_publisher/start").success, "and the next start waits again"
    assert until(lambda: publisher.text.count("preparing") == 2)
    slider.value = 100.0
    assert until(lambda: publisher.text.count("playing") == 2)
    slider.value = 99.0
    publisher.says("the robot's speed scaling is 99")
    assert publisher.end()[0] == 3, "a fault is one, whoever ends the node after it"
    assert robot.end()[0] == 0


@dataclass
class Arm:
    """An arm that stands still and can't be reset, so that it is no simulation of ours; its stamps are `ahead` [ns]."""

    client: Any
    ahead: int = 0

    def __post_init__(self) -> None:
        from sensor_msgs.msg import JointState

        self.states = self.client.create_publisher(JointState, "joint_states", 10)
        self.client.create_subscription(JointState, "joint_command", lambda message: None, 10)
        self.client.create_timer(0.01, self.tell)

    def tell(self) -> None:
        from rclpy.time import Time
        from sensor_msgs.msg import JointState

        message = JointState(name=list(load_robot().joints), position=[0.0] * 3)
        message.header.stamp = Time(nanoseconds=self.client.get_clock().now().nanoseconds + self.ahead).to_msg()
        self.states.publish(message)


@pytest.mark.long
def test_hardware_needs_a_controller_that_holds(start: Callable[..., Any], trajectory: Path, client: Any) -> None:
    Arm(client)
    ways = {"trajectory": trajectory, "autostart": True, "exit_when_done": True, "state_wait": 12.0, **PATIENT}
    publisher = start("trajectory_publisher", **ways)
    assert publisher.wait() == 2
    assert "on hardware, name the controller that holds the robot by itself" in publisher.text
    named = start("trajectory_publisher", **{**ways, "controller": "arm_controller"})
    named.says("approaching")


@pytest.mark.long
def test_a_driver_that_was_restarted_with_earlier_stamps_is_heard_again(
    start: Callable[..., Any], trajectory: Path, client: Any, call: Callable[..., Any], until: Callable[..., Any]
) -> None:
    from std_srvs.srv import Trigger

    arm = Arm(client, ahead=10**12)
    publisher = start(
        "trajectory_publisher", trajectory=trajectory, controller="arm_controller", autostart=True, **PATIENT
    )
    publisher.says("approaching")
    arm.ahead = 0
    publisher.says("halted: ")
    assert call(Trigger, "/trajectory_publisher/start").success
    assert until(lambda: publisher.text.count("approaching") == 2), publisher.text


def test_a_controllers_silence_counts_no_longer_than_its_trajectories_reach(
    start: Callable[..., Any], trajectory: Path
) -> None:
    ways = {"output": "joint_trajectory", "controller": "arm_controller", "state_timeout": 4.0}
    start("trajectory_publisher", trajectory=trajectory, **ways).says("state_timeout 4 s counts as 0.3 s")


def test_a_trajectory_output_needs_the_name(start: Callable[..., Any], trajectory: Path) -> None:
    publisher = start("trajectory_publisher", trajectory=trajectory, output="joint_trajectory")
    assert publisher.wait() == 2
    assert "output joint_trajectory needs the name of the controller" in publisher.text


def test_commands_that_come_too_rarely_are_refused(start: Callable[..., Any], trajectory: Path) -> None:
    """At two a second each would be a step of half a radian, with a robot that follows at once."""
    publisher = start("trajectory_publisher", trajectory=trajectory, rate=2.0)
    assert publisher.wait() == 2
    assert "parameter rate = 2: output joint_state needs 20 Hz or more" in publisher.text

"""The publisher as a managed node: configure certifies, activate allows, deactivate stops smoothly, cleanup forgets."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from commanded import assert_smooth

pytest.importorskip("rclpy")

from robot_ident.bags import read_messages  # noqa: E402
from robot_ident.robot import load_robot  # noqa: E402

NODE = "/trajectory_publisher"


@pytest.fixture
def move(call: Callable[..., Any]) -> Callable[[str], bool]:
    """Return a function that asks for a transition and returns whether it was made."""
    from lifecycle_msgs.msg import Transition
    from lifecycle_msgs.srv import ChangeState

    def ask(label: str) -> bool:
        request = ChangeState.Request(transition=Transition(label=label))
        return bool(call(ChangeState, f"{NODE}/change_state", request).success)

    return ask


@pytest.fixture
def state(call: Callable[..., Any]) -> Callable[[], str]:
    """Return a function that asks for the state."""
    from lifecycle_msgs.srv import GetState

    return lambda: str(call(GetState, f"{NODE}/get_state").current_state.label)


@pytest.mark.long
def test_a_managed_life(
    start: Callable[..., Any],
    call: Callable[..., Any],
    client: Any,
    until: Callable[..., Any],
    move: Callable[[str], bool],
    state: Callable[[], str],
    put: Callable[[str, str, Any], Any],
    trajectory: Path,
    tmp_path: Path,
) -> None:
    from sensor_msgs.msg import JointState
    from std_srvs.srv import Trigger

    simulated = {"use_sim_time": True}
    start("simulated_clock", speed=2.0)
    recorder = start("recorder", output=tmp_path / "bag", **simulated)
    robot = start("simulated_kuka", delay=0.2, **simulated)
    recorder.says("recording to")
    fast = tmp_path / "fast.yaml"
    fast.write_text(trajectory.read_text().replace("base_frequency: 1.0", "base_frequency: 1.5"))
    publisher = start(
        "trajectory_publisher",
        trajectory=fast,
        managed=True,
        periods=50,
        state_timeout=4.0,
        tracking_error="[0.3]",
        **simulated,
    )
    assert state() == "unconfigured"
    answer = call(Trigger, f"{NODE}/start")
    assert not answer.success and "unconfigured" in answer.message
    assert not move("activate"), "not before it is configured, and it doesn't end the node"
    assert not move("configure") and state() == "unconfigured"
    publisher.says("not certified for robot kuka_ir361")
    assert put(NODE, "trajectory", str(trajectory)).successful
    assert move("configure") and state() == "inactive"
    refused = put(NODE, "trajectory", str(fast))
    assert not refused.successful and "read by configure" in refused.reason
    assert not call(Trigger, f"{NODE}/start").success
    assert move("activate") and state() == "active"

    assert call(Trigger, f"{NODE}/start").success
    publisher.says("playing")
    refused = put(NODE, "tracking_error", [0.3, 0.3])
    assert not refused.successful and "one for each of 3 joints" in refused.reason
    assert put(NODE, "tracking_error", [0.3, 0.2, 0.3]).successful
    heard: list[Any] = []
    client.create_subscription(JointState, "joint_command", heard.append, 1000)
    assert until(lambda: len(heard) > 50)
    assert move("deactivate") and state() == "inactive"
    last = heard[-1]
    assert until(lambda: not any(heard[-1].velocity)), "it has come to rest"
    count = len(heard)
    assert not until(lambda: len(heard) > count + 5, 1.0), "and nothing is commanded any more"
    assert last.name == list(load_robot().joints)

    assert move("activate") and call(Trigger, f"{NODE}/start").success
    assert until(lambda: publisher.text.count("playing") == 2), publisher.text
    assert move("deactivate") and move("cleanup") and state() == "unconfigured"
    topics = [name for name, _ in client.get_publisher_names_and_types_by_node("trajectory_publisher", "/")]
    assert "/joint_command" not in topics
    assert move("configure") and move("activate") and move("shutdown")
    assert publisher.wait() == 0, publisher.text
    assert recorder.end()[0] == 0 and robot.end()[0] == 0
    assert len(list(read_messages(tmp_path / "bag", ["/joint_command"]))) > 300
    assert_smooth(tmp_path / "bag")


def test_by_default_it_is_active_at_once(start: Callable[..., Any], state: Callable[[], str], trajectory: Path) -> None:
    publisher = start("trajectory_publisher", trajectory=trajectory)
    assert state() == "active"
    assert publisher.end()[0] == 0, publisher.text

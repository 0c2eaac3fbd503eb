"""What ROS users expect: namespaces and remapping, several robots on one machine, quality of service overridden."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from commanded import assert_smooth, commands

pytest.importorskip("rclpy")

from robot_ident.bags import describe  # noqa: E402


@pytest.mark.long
def test_two_robots_on_one_machine(start: Callable[..., Any], trajectory: Path, tmp_path: Path) -> None:
    """Each in a namespace of its own, with a clock of its own; one has a command topic of another name as well."""
    ends, simulated = [], {"use_sim_time": True}
    for side, placed in (("left", "[0.2,0.0,-0.2]"), ("right", "[-0.2,0.1,0.2]")):
        own = ["-r", f"__ns:=/{side}", "-r", "/clock:=clock"]
        own += ["-r", "joint_command:=reference"] if side == "right" else []
        start("simulated_clock", *own, speed=2.0)
        recorder = start("recorder", *own, output=tmp_path / side, **simulated)
        robot = start("simulated_kuka", *own, initial_position=placed, delay=0.2, **simulated)
        recorder.says("recording to")
        publisher = start(
            "trajectory_publisher",
            *own,
            trajectory=trajectory,
            periods=1,
            autostart=True,
            exit_when_done=True,
            state_timeout=4.0,
            tracking_error="[0.3]",
            **simulated,
        )
        ends.append((publisher, recorder, robot))
    for publisher, recorder, robot in ends:
        assert publisher.wait() == 0, publisher.text
        assert recorder.end()[0] == 0 and robot.end()[0] == 0
    for side, topic in (("left", "/left/joint_command"), ("right", "/right/reference")):
        names = {one.name for one in describe(tmp_path / side).topics}
        assert names == {f"/{side}/joint_states", topic}, "nothing of the other robot"
        assert_smooth(tmp_path / side, topic)
    first = [commands(tmp_path / side, topic)[1][0] for side, topic in (("left", "/left/joint_command"),
                                                                       ("right", "/right/reference"))]  # fmt: skip
    assert abs(first[0][0] - 0.2) < 5e-3 and abs(first[1][0] + 0.2) < 5e-3, "each began where its robot stood"


def test_quality_of_service_is_overridden(
    start: Callable[..., Any], client: Any, until: Callable[..., Any], trajectory: Path
) -> None:
    """By the parameters that `ros2 param list` shows."""
    from rclpy.qos import ReliabilityPolicy

    robot = start("simulated_kuka", **{"qos_overrides./joint_states.publisher.reliability": "best_effort"})
    publisher = start(
        "trajectory_publisher",
        trajectory=trajectory,
        **{
            "qos_overrides./joint_states.subscription.reliability": "best_effort",
            "qos_overrides./joint_command.publisher.depth": 3,
        },
    )

    def infos() -> list[Any]:
        return [
            *client.get_publishers_info_by_topic("/joint_states"),
            *client.get_subscriptions_info_by_topic("/joint_states"),
        ]

    assert until(lambda: len(infos()) == 2), (robot.text, publisher.text)
    assert {info.qos_profile.reliability for info in infos()} == {ReliabilityPolicy.BEST_EFFORT}
    assert publisher.end()[0] == 0 and robot.end()[0] == 0

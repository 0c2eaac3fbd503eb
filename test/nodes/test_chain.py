"""Publisher, simulated robot and recorder in processes of their own, over real DDS; faults are injected for real."""

from __future__ import annotations

import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commanded import assert_smooth, commands

pytest.importorskip("rclpy")

from robot_ident.bags import read_recording  # noqa: E402
from robot_ident.estimation.identify import identify  # noqa: E402
from robot_ident.recording.measurement import Processing  # noqa: E402
from robot_ident.robot import load_robot  # noqa: E402
from robot_ident.trajectories.excitation import Excitation  # noqa: E402


@pytest.fixture
def chain(start: Callable[..., Any], trajectory: Path, tmp_path: Path) -> Callable[..., tuple[Any, Any, Any]]:
    """Return a function that starts recorder, simulated robot and publisher, in time that waits for both.

    The machine that runs tests may be busy: what is tested is that faults are found, not how fast.
    """

    def begin(*, settings: dict[str, object] | None = None, **values: object) -> tuple[Any, Any, Any]:
        simulated = {"use_sim_time": True}
        start("simulated_clock", speed=2.0)
        recorder = start("recorder", output=tmp_path / "bag", **simulated)
        placed = {"initial_position": "[0.2,0.0,-0.2]", "delay": 0.2}
        robot = start("simulated_kuka", **{**placed, **simulated, **(settings or {})})
        recorder.says("recording to")
        defaults = {"trajectory": trajectory, "autostart": True, "exit_when_done": True, "hold_time": 0.2}
        patient = {"state_timeout": 4.0, "tracking_error": "[0.3]", **simulated}
        return recorder, robot, start("trajectory_publisher", **{**defaults, **patient, **values})

    return begin


def test_excite_record_identify(chain: Callable[..., Any], trajectory: Path, tmp_path: Path) -> None:
    recorder, robot, publisher = chain(periods=8)
    assert publisher.wait() == 0, publisher.text
    assert recorder.end()[0] == 0, recorder.text
    assert robot.end()[0] == 0, robot.text
    assert_smooth(tmp_path / "bag")
    t, q, _ = commands(tmp_path / "bag")
    np.testing.assert_allclose(q[0], [0.2, 0.0, -0.2], atol=2e-3)
    steps = np.diff(t) * 150.0
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-3, err_msg="stamps off the even grid")

    recording = read_recording(tmp_path / "bag")
    assert recording.names == load_robot().joints and recording.dq is not None
    np.testing.assert_allclose(np.diff(recording.t), 1.0 / 150.0, atol=2e-9)
    series = Excitation.read(trajectory).series
    from_start = np.interp(recording.t, t, np.arange(len(t)))
    assert from_start.max() > 1200
    model = identify([recording], load_robot(), processing=Processing(series.base_frequency, True))
    assert model.noise.periods >= 8
    error = model.values - model.structure.true_values()
    chi2 = float(error @ np.linalg.solve(model.covariance, error))
    assert chi2 < 60.0, f"chi2 of 21 parameters {chi2:.1f}"


def test_silent_robot(chain: Callable[..., Any], tmp_path: Path) -> None:
    recorder, robot, publisher = chain(periods=50)
    publisher.says("playing")
    robot.end(signal.SIGKILL)
    assert publisher.wait() == 3, publisher.text
    assert "no new joint_states for" in publisher.text.splitlines()[-1] or "no new joint_states for" in publisher.text
    assert recorder.end()[0] == 0
    assert_smooth(tmp_path / "bag")
    _, _, dq = commands(tmp_path / "bag")
    assert not dq[-1].any(), "it ends at rest"


def test_robot_that_strays(chain: Callable[..., Any], tmp_path: Path) -> None:
    """The simulated robot is put back to its start in mid-motion: a jump in position."""
    recorder, robot, publisher = chain(periods=50, tracking_error="[0.02]", settings={"servo": "pd", "bandwidth": 0.5})
    assert publisher.wait() == 3, publisher.text
    assert "from where it was sent (bound 0.02)" in publisher.text
    assert recorder.end()[0] == 0
    assert_smooth(tmp_path / "bag")
    assert robot.end()[0] == 0


def test_interrupt_in_motion_stops_smoothly(
    chain: Callable[..., Any], tmp_path: Path, record_property: Callable[[str, object], None]
) -> None:
    recorder, robot, publisher = chain(periods=50)
    publisher.says("playing")
    code, seconds = publisher.end(signal.SIGINT)
    record_property("seconds to end", round(seconds, 2))
    assert code == 0, publisher.text
    assert recorder.end()[0] == 0
    assert_smooth(tmp_path / "bag")
    t, _, dq = commands(tmp_path / "bag")
    assert not dq[-1].any() and np.abs(dq).max() > 0.05
    assert robot.end()[0] == 0


def test_services_and_a_rival(
    chain: Callable[..., Any],
    client: Any,
    call: Callable[..., Any],
    until: Callable[..., Any],
    tmp_path: Path,
) -> None:
    from diagnostic_msgs.msg import DiagnosticArray
    from sensor_msgs.msg import JointState
    from std_srvs.srv import Trigger

    told: list[Any] = []

    def hear(message: DiagnosticArray) -> None:
        told.extend(message for status in message.status if status.name == "trajectory_publisher")

    client.create_subscription(DiagnosticArray, "/diagnostics", hear, 10)
    recorder, robot, publisher = chain(periods=50, autostart=False, exit_when_done=False)
    assert not call(Trigger, "/trajectory_publisher/stop").success
    assert call(Trigger, "/trajectory_publisher/start").success
    publisher.says("playing")
    again = call(Trigger, "/trajectory_publisher/start")
    assert not again.success and again.message == "already playing"
    assert until(lambda: told and "playing" in told[-1].status[0].message)
    assert call(Trigger, "/trajectory_publisher/stop").success
    publisher.says("holding: stopped by ~/stop")
    assert call(Trigger, "/trajectory_publisher/start").success
    assert until(lambda: publisher.text.count("playing") == 2), publisher.text
    rival = client.create_publisher(JointState, "joint_command", 10)
    publisher.says("test_client publishes on /joint_command as well")
    publisher.says("holding: test_client")
    client.destroy_publisher(rival)
    assert call(Trigger, "/simulated_kuka/reset").success
    assert publisher.end()[0] == 0
    assert recorder.end()[0] == 0
    assert_smooth(tmp_path / "bag")
    assert robot.end()[0] == 0


def test_no_robot(start: Callable[..., Any], trajectory: Path) -> None:
    publisher = start(
        "trajectory_publisher", trajectory=trajectory, autostart=True, exit_when_done=True, state_wait=0.5
    )
    assert publisher.wait() == 2
    assert "not started within 0.5 s: no joint_states" in publisher.text


def test_what_is_not_checked_is_refused_unless_accepted(
    start: Callable[..., Any], trajectory: Path, checkout: Path, tmp_path: Path
) -> None:
    source = (checkout / "config/robots/kuka_ir361.yaml").read_text(encoding="utf-8")
    source = source.replace("kuka_ir361.urdf", str(checkout / "config/robots/kuka_ir361.urdf"))
    robot = tmp_path / "arm.yaml"
    robot.write_text(source.replace("self_collision:", "# self_collision:"), encoding="utf-8")
    refused = start("trajectory_publisher", trajectory=trajectory, robot=robot)
    assert refused.wait() == 3
    what = "not checked: self-collision (no collision geometry in the URDF)"
    assert f"{what}; write the facts into the robot YAML, or set accept_unchecked:=true" in refused.text
    plant = start("simulated_kuka")
    accepted = start(
        "trajectory_publisher",
        trajectory=trajectory,
        robot=robot,
        periods=1,
        accept_unchecked=True,
        autostart=True,
        exit_when_done=True,
    )
    assert accepted.wait() == 0, accepted.text
    assert f"{what}\n" in accepted.text
    assert plant.end()[0] == 0


def test_a_trajectory_beyond_the_limits_is_refused(start: Callable[..., Any], trajectory: Path, tmp_path: Path) -> None:
    fast = tmp_path / "fast.yaml"
    fast.write_text(trajectory.read_text().replace("base_frequency: 1.0", "base_frequency: 1.5"))
    publisher = start("trajectory_publisher", trajectory=fast)
    assert publisher.wait() == 2
    assert "not certified for robot kuka_ir361: acceleration of joint_" in publisher.text

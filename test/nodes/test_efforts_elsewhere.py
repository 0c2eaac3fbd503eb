"""Efforts on topics of their own: the recorder finds them, and the estimator pairs them as the offline reader does."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from swelling import Swelling

pytest.importorskip("rclpy")

from robot_ident.bags import read_for  # noqa: E402
from robot_ident.cli.main import main  # noqa: E402
from robot_ident.estimation.identify import identify  # noqa: E402
from robot_ident.model.model_file import read_model  # noqa: E402
from robot_ident.recording.measurement import Processing  # noqa: E402
from robot_ident.recording.recording import Recording  # noqa: E402
from robot_ident.robot import load_robot  # noqa: E402
from robot_ident.testbed.simulation import simulate  # noqa: E402
from robot_ident.trajectories.excitation import Excitation  # noqa: E402

JOINTS = ("joint_1", "joint_2", "joint_3")


@pytest.fixture(scope="module")
def simulated(trajectory: Path) -> Recording:
    """Return a simulated recording of two seconds of transient and five periods."""
    made = simulate(load_robot(), Swelling(Excitation.read(trajectory).series)).recording
    return replace(made, start_ns=1_700_000_000_123_456_789)


def declared(path: Path, checkout: Path, effort: dict[str, Any], **joints: dict[str, float]) -> Path:
    source = yaml.safe_load((checkout / "config/robots/kuka_ir361.yaml").read_text(encoding="utf-8"))
    urdf = str(checkout / "config/robots/kuka_ir361.urdf")
    plain = {name: {k: v for k, v in source["joints"][name].items() if k != "torque_constant"} for name in JOINTS}
    told = {name: {**plain[name], **joints.get(name, {})} for name in JOINTS}
    path.write_text(yaml.safe_dump({**source, "urdf": urdf, "effort": effort, "joints": told}), encoding="utf-8")
    return path


class Driver:
    """Publishes positions on `joint_states` without efforts, and efforts of all joints elsewhere."""

    def __init__(self, client: Any, recording: Recording, kind: type, topic: str) -> None:
        from rclpy.qos import qos_profile_sensor_data
        from sensor_msgs.msg import JointState

        self.recording, self.kind = recording, kind
        self.states = client.create_publisher(JointState, "joint_states", 2000)
        # as drivers do: best effort, which a reliable subscription would not hear
        best_effort = qos_profile_sensor_data if kind is JointState else 2000
        self.efforts = client.create_publisher(kind, topic, best_effort)

    def play(self, rate: float, *, efforts: bool = True) -> None:
        from robot_ident.nodes.messages import joint_state

        one, begun = self.recording, time.monotonic()
        stamps = one.start_ns + np.rint(one.t * 1e9).astype(np.int64)
        for k, stamp in enumerate(stamps.tolist()):
            time.sleep(max(0.0, begun + one.t[k] / rate - time.monotonic()))
            self.states.publish(joint_state(JOINTS, stamp, one.q[k]))
            if efforts and self.kind.__name__ == "JointState":
                # half a millisecond later, joints in another order, in the field that YAML names
                self.efforts.publish(joint_state(JOINTS[::-1], stamp + 500_000, dq=-one.tau[k, ::-1]))
            elif efforts:
                self.efforts.publish(self.kind(data=[99.0, 1.5, 2.5, 3.5]))


def test_the_estimator_gives_what_the_recorders_bag_gives(
    start: Callable[..., Any],
    client: Any,
    until: Callable[..., Any],
    checkout: Path,
    simulated: Recording,
    tmp_path: Path,
) -> None:
    from sensor_msgs.msg import JointState

    robot = declared(tmp_path / "arm.yaml", checkout, {"topic": "/drives", "field": "velocity", "sign": -1})
    output, bag = tmp_path / "model.yaml", tmp_path / "bag"
    driver = Driver(client, simulated, JointState, "/drives")
    residual: list[Any] = []
    client.create_subscription(JointState, "/estimator/residual", residual.append, 5000)
    estimator = start("estimator", robot=robot, base_frequency=1.0, output=output, silence=3.0, each_period=False)
    recorder = start("recorder", robot=robot, output=bag)
    assert until(lambda: driver.states.get_subscription_count() == 2)
    assert until(lambda: driver.efforts.get_subscription_count() == 2), "both find where efforts stand by themselves"
    time.sleep(1.0)
    driver.play(1.0)
    assert until(output.is_file), estimator.text
    assert recorder.end()[0] == 0, recorder.text
    arm = load_robot(robot)
    expected = identify([read_for(bag, arm)], arm, processing=Processing(1.0, True))
    found = read_model(output)
    np.testing.assert_array_equal(found.values, expected.values)
    np.testing.assert_array_equal(found.covariance, expected.covariance)
    plain = identify([simulated], load_robot(), processing=Processing(1.0, True))
    np.testing.assert_allclose(found.values, plain.values, atol=5 * float(plain.std.max()))
    driver.play(2.0)
    assert until(lambda: len(residual) > 0.8 * simulated.samples), len(residual)
    rms = np.sqrt(np.mean(np.array([message.effort for message in residual]) ** 2, axis=0))
    np.testing.assert_allclose(rms, [20.0, 20.4, 12.65], rtol=0.2)  # the noise of one sample and little else
    assert estimator.end()[0] == 0, estimator.text


@pytest.mark.long
def test_a_silent_topic_of_efforts_is_told_and_arrays_are_paired_by_arrival(
    start: Callable[..., Any],
    client: Any,
    until: Callable[..., Any],
    checkout: Path,
    simulated: Recording,
    tmp_path: Path,
) -> None:
    from diagnostic_msgs.msg import DiagnosticArray
    from sensor_msgs.msg import JointState
    from std_msgs.msg import Float64MultiArray

    from robot_ident.model.model_file import write_model

    robot = declared(tmp_path / "arm.yaml", checkout, {"topic": "/torques", "field": "data"})
    model = tmp_path / "model.yaml"
    write_model(identify([simulated], load_robot(), processing=Processing(1.0, True)), model)
    told: list[Any] = []
    residual: list[Any] = []
    predicted: list[Any] = []
    client.create_subscription(DiagnosticArray, "/estimator/diagnostics", lambda m: told.append(m.status[0]), 10)
    client.create_subscription(JointState, "/estimator/residual", residual.append, 5000)
    client.create_subscription(JointState, "/estimator/predicted", predicted.append, 5000)
    estimator = start("estimator", robot=robot, model=model, automatic=False, silence=0.5)
    assert until(lambda: told and "no effort of joint_1, joint_2, joint_3 on /torques yet" in told[-1].message), told
    assert told[-1].level == b"\x01" and "nobody publishes there" in told[-1].message
    driver = Driver(client, simulated, Float64MultiArray, "/torques")
    assert until(driver.efforts.get_subscription_count)
    driver.play(4.0, efforts=False)
    assert until(lambda: any("its publisher says nothing" in status.message for status in told)), told[-1].message
    assert not residual
    driver.play(1.0)
    assert until(lambda: len(residual) > 100 and len(predicted) > 100)
    model_said = {(m.header.stamp.sec, m.header.stamp.nanosec): np.array(m.effort) for m in list(predicted)}
    pairs = [(np.array(m.effort), model_said.get((m.header.stamp.sec, m.header.stamp.nanosec))) for m in list(residual)]
    sums = [left + right for left, right in pairs if right is not None]
    assert len(sums) > 50
    np.testing.assert_allclose(sums, np.tile([99.0, 1.5, 2.5], (len(sums), 1)), atol=1e-9)
    assert estimator.end()[0] == 0, estimator.text


AMPERE = {"quantity": "current", "sign": -1, "gain": 0.001, "topic": "/currents", "field": "data"}
SLIGHT = {"torque_constant": 0.01}  # Nm/A: 100 times as many amperes as Nm, beyond every torque limit if taken for one


@pytest.mark.parametrize(
    ("third", "code"),
    [
        pytest.param({"current": 1e5}, 0, marks=pytest.mark.long),
        ({"current": 1.0}, 3),
        pytest.param({}, 0, marks=pytest.mark.long),
    ],
)
def test_the_publisher_watches_currents_by_what_they_are(
    start: Callable[..., Any], trajectory: Path, checkout: Path, tmp_path: Path, third: dict[str, float], code: int
) -> None:
    path = tmp_path / "arm.yaml"
    robot = declared(path, checkout, AMPERE, joint_1=SLIGHT, joint_2=SLIGHT, joint_3=third)
    timed = {"use_sim_time": True, "robot": robot}
    start("simulated_clock", speed=3.0)
    simulated = start("simulated_kuka", noise=0.0, **timed)
    recorder = start("recorder", output=tmp_path / "bag", **timed)
    recorder.says("recording to")
    patient = {"state_timeout": 4.0, "tracking_error": "[0.3]", "autostart": True, "exit_when_done": True}
    play = {"trajectory": trajectory, "periods": 1, "rehearsal": "[0.5]", **patient, **timed}
    publisher = start("trajectory_publisher", **play)
    assert publisher.wait() == code, publisher.text
    assert simulated.end()[0] == 0 and recorder.end()[0] == 0
    assert ("the effort of joint_3 is not watched, and rehearsals judge tracking alone there" in publisher.text) == (
        not third
    ), publisher.text
    assert ("the effort of joint_3 is " in publisher.text and "A (bound 1.2 A)" in publisher.text) == (code == 3)
    if not code:
        assert "rehearsal at 50% used" in publisher.text
        recorded = read_for(tmp_path / "bag", load_robot(robot))
        at_joints = -1e-3 * recorded.tau * [0.01, 0.01, 1.0]
        assert np.abs(at_joints).max() > 50.0, "gravity alone makes as many Nm"
        assert np.abs(recorded.tau[:, 0]).max() > 1e5 * 0.5
        assert main(["info", str(tmp_path / "bag"), "--robot", str(robot)]) == 0, "so many mA are no wrong unit"

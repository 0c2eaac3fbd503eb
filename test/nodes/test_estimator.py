"""The estimator gives what the offline command gives, to the last digit, and shows the residual live."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from swelling import Swelling

pytest.importorskip("rclpy")

from robot_ident.bags import read_recording, write_recording  # noqa: E402
from robot_ident.errors import InputError  # noqa: E402
from robot_ident.estimation.identify import identify  # noqa: E402
from robot_ident.model.model_file import read_model  # noqa: E402
from robot_ident.recording.measurement import Processing  # noqa: E402
from robot_ident.robot import load_robot  # noqa: E402
from robot_ident.signals.motion import Array  # noqa: E402
from robot_ident.testbed.simulation import simulate  # noqa: E402
from robot_ident.trajectories.excitation import Excitation  # noqa: E402


@pytest.fixture(scope="module")
def bag(trajectory: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a simulated recording of two seconds of transient and five periods."""
    path = tmp_path_factory.mktemp("simulated") / "bag"
    result = simulate(load_robot(), Swelling(Excitation.read(trajectory).series))
    write_recording(path, result.recording, start_ns=1_700_000_000_123_456_789)
    return path


def collect(client: Any, topic: str) -> list[Any]:
    from sensor_msgs.msg import JointState

    got: list[Any] = []
    client.create_subscription(JointState, topic, got.append, 5000)
    return got


def by_stamp(messages: list[Any]) -> dict[int, Array]:
    return {m.header.stamp.sec * 10**9 + m.header.stamp.nanosec: np.array(m.effort) for m in list(messages)}


def offline(bag: Path, **options: Any) -> Any:
    return identify([read_recording(bag)], load_robot(), processing=Processing(1.0, True), **options)


def test_replay_gives_the_parameters_of_the_offline_command(
    start: Callable[..., Any], client: Any, until: Callable[..., Any], bag: Path, trajectory: Path, tmp_path: Path
) -> None:
    from diagnostic_msgs.msg import DiagnosticArray

    from robot_ident.nodes.replay import replay

    told: list[DiagnosticArray] = []
    client.create_subscription(DiagnosticArray, "/estimator/diagnostics", told.append, 10)
    residual = collect(client, "/estimator/residual")
    predicted = collect(client, "/estimator/predicted")
    output = tmp_path / "model.yaml"
    estimator = start("estimator", trajectory=trajectory, output=output, silence=1.0)
    recording = read_recording(bag)
    shares: list[float] = []
    assert replay(recording, rate=10.0, progress=shares.append) == recording.samples
    assert shares == sorted(shares) and shares[-1] == 1.0
    assert until(output.is_file), estimator.text
    expected, found = offline(bag), read_model(output)
    np.testing.assert_array_equal(found.values, expected.values)
    np.testing.assert_array_equal(found.covariance, expected.covariance)
    assert found.noise.periods == expected.noise.periods == 5
    assert until(lambda: told and any(value.key == "p1" for value in told[-1].status[0].values))

    residual.clear()  # of an earlier model, where the machine stood still for a second and that looked like silence
    predicted.clear()
    replay(recording, rate=2.0)
    assert until(lambda: len(residual) > 0.9 * recording.samples), f"{len(residual)} of {recording.samples}"
    known = recording.start_ns + np.rint(recording.t * 1e9).astype(np.int64)
    of_row = dict(zip(known.tolist(), recording.tau, strict=True))
    left, model = by_stamp(residual), by_stamp(predicted)
    common = sorted(set(left) & set(model))
    assert len(common) > 0.85 * recording.samples
    for stamp in common:
        np.testing.assert_allclose(left[stamp] + model[stamp], of_row[stamp], atol=1e-9)
    rms = np.sqrt(np.mean(np.array(list(left.values())) ** 2, axis=0))
    np.testing.assert_allclose(rms, [20.0, 20.4, 12.65], rtol=0.12)  # the noise of one sample and little else
    assert estimator.end()[0] == 0, estimator.text


def test_identify_service_and_live_parameters(
    start: Callable[..., Any], call: Callable[..., Any], put: Callable[[str, str, Any], Any], bag: Path, tmp_path: Path
) -> None:
    from std_srvs.srv import Trigger

    from robot_ident.nodes.replay import replay

    output = tmp_path / "model.yaml"
    estimator = start("estimator", base_frequency=1.0, output=output, automatic=False)
    answer = call(Trigger, "/estimator/identify")
    assert not answer.success and "nothing has been received" in answer.message
    replay(read_recording(bag), rate=20.0)
    assert not output.exists()
    assert put("/estimator", "estimator", "ls").successful
    refused = put("/estimator", "estimator", "lsq")
    assert not refused.successful and "did you mean" in refused.reason
    answer = call(Trigger, "/estimator/identify")
    assert answer.success and "21 parameters from 5 periods" in answer.message
    found, expected = read_model(output), offline(bag, estimator="ls")
    assert found.estimator == "ls"
    np.testing.assert_array_equal(found.values, expected.values)
    assert estimator.end()[0] == 0, estimator.text


def test_replay_without_a_listener(domain: int, bag: Path) -> None:
    from robot_ident.nodes.replay import replay

    recording = read_recording(bag)
    with pytest.raises(InputError, match="nobody listens"):
        replay(recording, wait=0.3)
    with pytest.raises(InputError, match="above 0"):
        replay(recording, rate=0.0)


@pytest.mark.long
def test_a_change_of_friction_shows_while_the_robot_runs(
    start: Callable[..., Any],
    client: Any,
    put: Callable[[str, str, Any], Any],
    until: Callable[..., Any],
    bag: Path,
    trajectory: Path,
    tmp_path: Path,
) -> None:
    from diagnostic_msgs.msg import DiagnosticArray

    from robot_ident.model.model_file import write_model
    from robot_ident.nodes.replay import replay
    from robot_ident.recording import Recording

    model = tmp_path / "model.yaml"
    write_model(offline(bag), model)
    told: list[DiagnosticArray] = []
    client.create_subscription(DiagnosticArray, "/estimator/diagnostics", told.append, 10)
    estimator = start("estimator", trajectory=trajectory, model=model, automatic=False, watch_window=2.0)
    recorded = read_recording(bag)
    steady = slice(-600, None)  # 4 periods of 150 samples, which repeat without a seam
    q, tau = np.tile(recorded.q[steady], (3, 1)), np.tile(recorded.tau[steady], (3, 1))
    t = np.arange(len(q)) / 150.0
    velocity = np.gradient(q[:, 1])
    tau[:, 1] += np.where(t > 7.0, 25.0 * np.sign(velocity), 0.0)  # the friction of joint_2 has changed
    changed = Recording(recorded.names, t, q, tau, source="changed", start_ns=1_700_000_100_000_000_000)
    replay(changed, rate=4.0)

    def values() -> dict[str, str]:
        return {value.key: value.value for value in told[-1].status[0].values} if told else {}

    assert until(lambda: told and "the robot has changed" in told[-1].status[0].message), (estimator.text, values())
    said = told[-1].status[0]
    assert said.level == b"\x01"
    assert "joint_2: coulomb +" in said.message
    assert "joint_1" not in said.message and "joint_3" not in said.message
    assert "at first" in values()["live residual joint_2"]
    for name, given, accepted in (
        ("watch_change", 0.5, True),
        ("watch_window", 1.0, True),
        ("watch_change", 0.0, False),
    ):
        assert put("/estimator", name, given).successful == accepted
    replay(Recording(recorded.names, t[:900], q[:900], tau[:900], source="anew"), rate=4.0)  # before the change
    assert until(lambda: "changed" not in told[-1].status[0].message), values()  # the watch has begun anew
    assert estimator.end()[0] == 0, estimator.text


@pytest.mark.long
def test_covariance_is_live_and_another_model_can_be_set(
    start: Callable[..., Any],
    client: Any,
    put: Callable[[str, str, Any], Any],
    until: Callable[..., Any],
    bag: Path,
    tmp_path: Path,
) -> None:
    from std_msgs.msg import Float64MultiArray, String

    from robot_ident.model.model_file import write_model
    from robot_ident.nodes.node import latched
    from robot_ident.nodes.replay import replay

    covariances: list[Float64MultiArray] = []
    verdicts: list[str] = []
    client.create_subscription(Float64MultiArray, "/estimator/covariance", covariances.append, latched())
    client.create_subscription(String, "/estimator/verdict", lambda message: verdicts.append(message.data), latched())
    output = tmp_path / "model.yaml"
    estimator = start("estimator", base_frequency=1.0, silence=1.0, output=output)
    replay(read_recording(bag), rate=1.0)
    assert until(output.is_file), estimator.text
    expected = offline(bag)
    assert until(lambda: covariances and np.array_equal(covariances[-1].data, expected.covariance.ravel()))
    labels = covariances[-1].layout.dim[0].label.split()
    assert labels == [parameter.name for parameter in expected.structure.parameters]
    assert len(covariances) >= 2, "told before the end as well"
    assert covariances[0].data[0] > covariances[-1].data[0], "more periods, less uncertainty"
    assert until(lambda: any("from 5 periods" in text for text in verdicts)), verdicts

    refused = put("/estimator", "model", str(tmp_path / "nothing.yaml"))
    assert not refused.successful and "nothing.yaml" in refused.reason
    other, plain = tmp_path / "other.yaml", offline(bag, estimator="ls")
    write_model(plain, other)
    assert put("/estimator", "model", str(other)).successful
    assert until(lambda: np.array_equal(covariances[-1].data, plain.covariance.ravel()))
    assert until(lambda: any("predicts with" in text for text in verdicts)), verdicts
    assert estimator.end()[0] == 0, estimator.text


def test_joint_states_are_taken_in_while_one_waits_for_an_identification(
    start: Callable[..., Any], client: Any, until: Callable[..., Any], bag: Path
) -> None:
    from diagnostic_msgs.msg import DiagnosticArray
    from std_srvs.srv import Trigger

    from robot_ident.nodes.replay import replay

    told: list[dict[str, str]] = []

    def hear(message: DiagnosticArray) -> None:
        told.append({"": message.status[0].message, **{one.key: one.value for one in message.status[0].values}})

    client.create_subscription(DiagnosticArray, "/estimator/diagnostics", hear, 10)
    estimator = start("estimator", base_frequency=1.0, automatic=False)
    recording = read_recording(bag)
    replay(recording, rate=20.0)
    service = client.create_client(Trigger, "/estimator/identify")
    assert service.wait_for_service(timeout_sec=40.0)
    answers = [service.call_async(Trigger.Request()) for _ in range(3)]  # one after the other
    replay(recording, rate=20.0)
    assert until(lambda: told and told[-1]["received"] == str(2 * recording.samples)), told[-1]
    assert until(lambda: all(answer.done() for answer in answers)), estimator.text
    assert answers[0].result().success, estimator.text
    assert estimator.end()[0] == 0, estimator.text

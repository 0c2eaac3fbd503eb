"""The estimator gives what the offline command gives, to the last digit, and shows the residual live."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rclpy")

from robot_ident.bags import read_recording, write_recording  # noqa: E402
from robot_ident.errors import InputError  # noqa: E402
from robot_ident.estimation.identify import identify  # noqa: E402
from robot_ident.excitation.excitation import Excitation  # noqa: E402
from robot_ident.excitation.fourier import FourierSeries  # noqa: E402
from robot_ident.model.model_file import read_model  # noqa: E402
from robot_ident.motion import Array, Motion  # noqa: E402
from robot_ident.recording.measurement import Processing  # noqa: E402
from robot_ident.robot import load_robot  # noqa: E402
from robot_ident.simulation.simulate import simulate  # noqa: E402


@dataclass(frozen=True)
class Swelling:
    """A series that swells from rest to its full size within two seconds."""

    series: FourierSeries
    duration: float = 7.0

    @property
    def start_pose(self) -> Array:
        return self.series.q0

    def reference(self, t: Array) -> Motion:
        m = self.series.motion(t)
        s = np.clip(np.asarray(t) / 2.0, 0.0, 1.0)[:, None]
        f, df, ddf = s**3 * (10 - 15 * s + 6 * s * s), 15 * (s - s * s) ** 2, 15 * (s - 3 * s * s + 2 * s**3)
        away = m.q - self.series.q0
        return Motion(self.series.q0 + f * away, f * m.dq + df * away, f * m.ddq + 2 * df * m.dq + ddf * away)


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
    start: Callable[..., Any], client: Any, call: Callable[..., Any], bag: Path, trajectory: Path, tmp_path: Path
) -> None:
    from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
    from rcl_interfaces.srv import SetParameters
    from std_srvs.srv import Trigger

    from robot_ident.nodes.replay import replay

    output = tmp_path / "model.yaml"
    estimator = start("estimator", base_frequency=1.0, output=output, automatic=False)
    answer = call(Trigger, "/estimator/identify")
    assert not answer.success and "nothing has been received" in answer.message
    replay(read_recording(bag), rate=20.0)
    assert not output.exists()
    value = ParameterValue(type=ParameterType.PARAMETER_STRING, string_value="ls")
    request = SetParameters.Request(parameters=[Parameter(name="estimator", value=value)])
    assert call(SetParameters, "/estimator/set_parameters", request).results[0].successful
    value = ParameterValue(type=ParameterType.PARAMETER_STRING, string_value="lsq")
    request = SetParameters.Request(parameters=[Parameter(name="estimator", value=value)])
    refused = call(SetParameters, "/estimator/set_parameters", request).results[0]
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

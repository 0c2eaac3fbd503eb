"""Every parameter has type, bound and description; config/ documents each; bad values are told in one line."""

from __future__ import annotations

import importlib
import math
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml

pytest.importorskip("rclpy")

from robot_ident.nodes.parameters import Parameter  # noqa: E402
from robot_ident.provenance import config_file  # noqa: E402

NODES = {
    "trajectory_publisher": "TrajectoryPublisher",
    "simulated_kuka": "SimulatedKuka",
    "recorder": "Recorder",
    "estimator": "Estimator",
    "simulated_clock": "SimulatedClock",
}


def table(node: str) -> tuple[Parameter, ...]:
    found: tuple[Parameter, ...] = getattr(importlib.import_module(f"robot_ident.nodes.{node}"), NODES[node]).table
    return found


@pytest.mark.parametrize("node", NODES)
def test_config_holds_every_parameter(node: str) -> None:
    path = config_file(f"{node}.yaml")
    content = yaml.safe_load(path.read_text())
    values = content["/**"]["ros__parameters"]
    assert list(values) == [parameter.name for parameter in table(node)]
    lines = path.read_text().splitlines()
    for parameter in table(node):
        assert values[parameter.name] == parameter.default, parameter.name
        place = next(k for k, line in enumerate(lines) if line.startswith(f"    {parameter.name}:"))
        comment = " ".join(line.strip(" #") for line in lines[:place] if line.strip().startswith("#"))
        assert parameter.description in " ".join(comment.split()), f"{path}: {parameter.name}"


@pytest.mark.parametrize("node", NODES)
def test_table_is_complete(node: str) -> None:
    for parameter in table(node):
        assert len(parameter.description) > 10
        assert parameter.checked(parameter.default) == parameter.default
        if parameter.kind in (int, float):
            assert math.isfinite(parameter.lower) and math.isfinite(parameter.upper), parameter.name


@pytest.mark.parametrize("node", NODES)
def test_node_describes_itself_and_ends_cleanly(
    node: str,
    start: Callable[..., Any],
    client: Any,
    call: Callable[..., Any],
    trajectory: Path,
    tmp_path: Path,
    record_property: Callable[[str, object], None],
) -> None:

    from rcl_interfaces.srv import DescribeParameters

    values = {"trajectory": trajectory} if node == "trajectory_publisher" else {}
    if node == "recorder":
        values = {"output": tmp_path / "bag"}
    process = start(node, "-r", "__ns:=/left", "--params-file", str(config_file(f"{node}.yaml")), **values)
    names = [parameter.name for parameter in table(node)]
    request = DescribeParameters.Request(names=names)
    answer = call(DescribeParameters, f"/left/{node}/describe_parameters", request)
    assert len(answer.descriptors) == len(names), process.text
    for parameter, descriptor in zip(table(node), answer.descriptors, strict=True):
        assert descriptor.type != 0 and parameter.description in descriptor.description
        assert descriptor.additional_constraints == parameter.bound
        assert descriptor.read_only is not (parameter.live or parameter.until_configured)
        if parameter.kind in (int, float) and not isinstance(parameter.default, list):
            (limits,) = descriptor.floating_point_range or descriptor.integer_range
            assert limits.from_value == parameter.lower and limits.to_value == parameter.upper
    topics = {name for name, _ in client.get_topic_names_and_types()}
    assert topics & {"/left/joint_states", "/left/joint_command"}, "names are relative to the namespace"
    code, seconds = process.end(signal.SIGTERM if node == "estimator" else signal.SIGINT)
    record_property("seconds to end", round(seconds, 2))
    assert code == 0, process.text
    assert seconds < 10.0, "it hung"


@pytest.mark.parametrize(
    ("node", "values", "words"),
    [
        ("recorder", {"depth": 0}, "parameter depth = 0 is out of bounds"),
        ("recorder", {"output": "."}, "exists already"),
        ("trajectory_publisher", {}, "name an excitation.yaml"),
        ("trajectory_publisher", {"trajectory": "nothing.yaml"}, "nothing.yaml"),
        ("simulated_kuka", {"robot": "kuka_ir631"}, "did you mean 'kuka_ir361'"),
        ("simulated_kuka", {"servo": "fedforward"}, "did you mean 'feedforward'"),
        ("estimator", {"periods": "many"}, "parameter periods = 'many': a whole number is needed"),
    ],
)
def test_bad_values_are_one_line_and_exit_2(
    node: str, values: dict[str, object], words: str, start: Callable[..., Any]
) -> None:
    process = start(node, **values)
    assert process.wait() == 2, process.text
    lines = [line for line in process.text.splitlines() if line.strip()]
    assert words in lines[-1] and len(lines) == 1, process.text


def test_unknown_arguments_and_parameters(start: Callable[..., Any], tmp_path: Path) -> None:
    process = start("recorder", "--ros-args", "-p", "no")
    assert process.wait() == 2 and "Traceback" not in process.text
    process = start("recorder", output=tmp_path / "bag", topiks="a")
    process.says("unknown parameter 'topiks' is ignored; did you mean 'topics'?")
    assert process.end()[0] == 0


def test_whole_numbers_will_do_for_numbers() -> None:
    parameter = Parameter("rate", 150.0, "rate of something", 1.0, 200.0)
    assert parameter.checked(120) == 120.0
    assert isinstance(parameter.checked(120), float)
    many = Parameter("bound", [0.1], "bound of something", 0.0, 1.0)
    assert many.checked([1, 0.5]) == [1.0, 0.5]
    assert many.checked([]) == [0.1]

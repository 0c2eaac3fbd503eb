"""The launch file, on stand-ins for `launch` and `launch_ros`, which exist in a full ROS 2 installation only."""

from __future__ import annotations

import importlib
import importlib.util
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

NAMES = {
    "launch": ["LaunchDescription"],
    "launch.actions": ["DeclareLaunchArgument", "Shutdown"],
    "launch.conditions": ["IfCondition"],
    "launch.substitutions": ["LaunchConfiguration", "PathJoinSubstitution"],
    "launch_ros": [],
    "launch_ros.actions": ["Node"],
    "launch_ros.parameter_descriptions": ["ParameterValue"],
    "launch_ros.substitutions": ["FindPackageShare"],
}


class StandIn:
    """Keeps what it is made of."""

    def __init__(self, *args: Any, **options: Any) -> None:
        self.args, self.options = args, options

    def configurations(self) -> set[str]:
        """Return the names of all launch arguments that are used in here."""
        own = {str(self.args[0])} if type(self).__name__ == "LaunchConfiguration" else set()
        return own.union(*(_used(value) for value in (*self.args, *self.options.values())))


def _used(value: Any) -> set[str]:
    if isinstance(value, StandIn):
        return value.configurations()
    if isinstance(value, dict):
        return set().union(*map(_used, value.values()))
    return set().union(*map(_used, value)) if isinstance(value, (list, tuple)) else set()


@pytest.fixture
def description(checkout: Path, monkeypatch: pytest.MonkeyPatch) -> list[StandIn]:
    for name, classes in NAMES.items():
        module = ModuleType(name)
        for one in classes:
            setattr(module, one, type(one, (StandIn,), {}))
        monkeypatch.setitem(sys.modules, name, module)
    spec = importlib.util.spec_from_file_location("identify_launch", checkout / "launch" / "identify.launch.py")
    assert spec and spec.loader
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    entities: list[StandIn] = module.generate_launch_description().args[0]
    return entities


def of(entities: list[StandIn], kind: str) -> list[StandIn]:
    return [entity for entity in entities if type(entity).__name__ == kind]


def test_arguments_are_described_and_used(description: list[StandIn]) -> None:
    declared = {str(argument.args[0]) for argument in of(description, "DeclareLaunchArgument")}
    assert all(argument.options["description"] for argument in of(description, "DeclareLaunchArgument"))
    assert set().union(*(node.configurations() for node in of(description, "Node"))) == declared


def test_nodes_know_their_parameters(description: list[StandIn], checkout: Path) -> None:
    """A parameter that a node doesn't declare would be ignored at start-up."""
    nodes = {node.options["executable"]: node for node in of(description, "Node")}
    assert set(nodes) == {"simulated_kuka", "trajectory_publisher", "recorder", "estimator"}
    for name, node in nodes.items():
        file, own = node.options["parameters"]
        assert (checkout / "config" / file.args[0][-1]).is_file()
        found = vars(importlib.import_module(f"robot_ident.nodes.{name}")).values()
        (table,) = [kind.table for kind in found if getattr(kind, "node_name", None) == name]
        kinds = {parameter.name: parameter.kind for parameter in table} | {"use_sim_time": bool}
        assert {key: value.options["value_type"] for key, value in own.items()} == {key: kinds[key] for key in own}


def test_the_robot_does_not_move_unasked(description: list[StandIn]) -> None:
    defaults = {a.args[0]: a.options["default_value"] for a in of(description, "DeclareLaunchArgument")}
    assert (defaults["autostart"], defaults["simulation"]) == ("false", "false")

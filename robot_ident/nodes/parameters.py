"""Node parameters: type, default, bound and description of each stand in one place."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor, SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter

from robot_ident.errors import InputError, did_you_mean

Value = bool | int | float | str | list[str] | list[float]
_WORDS = {bool: "true or false", int: "a whole number", float: "a number", str: "a text"}


@dataclass(frozen=True)
class Parameter:
    """One parameter of a node. Its type is that of the default; a list is never empty: [''] stands for none.

    lower, upper: inclusive bounds of a number, or of each in a list; both or neither. choices: the texts that are
    allowed. unit: of a number. live: it may be changed while the node runs and is read when it is next needed;
    until_configured: it may be changed until a managed node is configured; the others are read once.
    """

    name: str
    default: Value
    description: str
    lower: float = -math.inf
    upper: float = math.inf
    choices: tuple[str, ...] = ()
    unit: str = ""
    live: bool = False
    until_configured: bool = False

    @property
    def kind(self) -> type[Any]:
        """The type of the value, or of each in a list."""
        return type(self.default[0] if isinstance(self.default, list) else self.default)

    @property
    def _bounded(self) -> bool:
        return math.isfinite(self.lower) and math.isfinite(self.upper)

    @property
    def bound(self) -> str:
        """The bound in words."""
        if self.choices:
            return "one of " + ", ".join(repr(choice) for choice in self.choices)
        if self._bounded:
            return f"{self.lower:g} to {self.upper:g}" + (f" {self.unit}" if self.unit else "")
        return {bool: "true or false", str: "any text"}.get(self.kind, "any number")

    def checked(self, value: Any) -> Value:
        """Return the value in its type (a whole number will do for a number); InputError when it is out of bounds."""
        if isinstance(self.default, list):
            if isinstance(value, str | bytes) or not hasattr(value, "__len__"):
                raise InputError(f"parameter {self.name} = {value!r}: a list is needed, as in {self.default}")
            items: list[Any] = [self._item(item) for item in value]
            return items or self.default
        return self._item(value)

    def _item(self, value: Any) -> Any:
        if self.kind is float and type(value) is int:
            value = float(value)
        if type(value) is not self.kind:
            hint = f" (write '\"{value}\"')" if self.kind is str else ""
            raise InputError(f"parameter {self.name} = {value!r}: {_WORDS[self.kind]} is needed{hint}")
        if self.choices and value not in self.choices:
            raise InputError(
                f"parameter {self.name} = {value!r}{did_you_mean(value, self.choices)}; it is {self.bound}"
            )
        if self.kind in (int, float) and not self.lower <= value <= self.upper:
            raise InputError(f"parameter {self.name} = {value!r} is out of bounds; it must be within {self.bound}")
        return value

    def descriptor(self) -> ParameterDescriptor:
        """Return what `ros2 param describe` shows."""
        unit = f" [{self.unit}]" if self.unit else ""
        descriptor = ParameterDescriptor(
            name=self.name,
            description=self.description + unit,
            additional_constraints=self.bound,
            read_only=not (self.live or self.until_configured),
        )
        if not self._bounded or isinstance(self.default, list):
            return descriptor
        if self.kind is float:
            bounds = FloatingPointRange(from_value=float(self.lower), to_value=float(self.upper), step=0.0)
            descriptor.floating_point_range = [bounds]
        else:
            descriptor.integer_range = [IntegerRange(from_value=int(self.lower), to_value=int(self.upper), step=0)]
        return descriptor


live = partial(Parameter, live=True)
until_configured = partial(Parameter, until_configured=True)


def declare(node: Node, table: Iterable[Parameter]) -> None:
    """Declare a node's parameters with the values from files and the command line.

    InputError names the parameter and its value where these don't fit; unknown names are warned of.
    """
    table = tuple(table)
    given: Mapping[str, RosParameter] = node._parameter_overrides  # the one place where rclpy keeps what was given
    for parameter in table:
        value = parameter.default
        if parameter.name in given and given[parameter.name].type_ != RosParameter.Type.NOT_SET:
            value = parameter.checked(given[parameter.name].value)
        node.declare_parameter(parameter.name, value, parameter.descriptor(), ignore_override=True)
    known = [parameter.name for parameter in table]
    for name in given:
        if not node.has_parameter(name) and not name.startswith(("qos_overrides.", "use_sim_time")):
            node.get_logger().warning(f"unknown parameter {name!r} is ignored{did_you_mean(name, known)}")

    def check(changes: list[RosParameter]) -> SetParametersResult:
        for change in changes:
            for parameter in table:
                if parameter.name == change.name:
                    try:
                        parameter.checked(change.value)
                    except InputError as error:
                        return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    node.add_on_set_parameters_callback(check)


def usage(name: str, description: str, table: Iterable[Parameter]) -> str:
    """Return the help text of a node."""
    lines = [
        f"{name}: {description}",
        "",
        f"usage: {name} [--ros-args --params-file FILE -p NAME:=VALUE -r FROM:=TO]",
        "",
        "parameters:",
    ]
    for parameter in table:
        default = "''" if parameter.default == "" else parameter.default
        lines.append(f"  {parameter.name} ({parameter.bound}; default {default})")
        lines.append(f"      {parameter.description}")
    return "\n".join(lines) + "\n"

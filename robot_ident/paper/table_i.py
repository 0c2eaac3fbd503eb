"""Table I: the printed parameters beside those that are simulated, and what makes the printed ones impossible."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from robot_ident.model.structure import Structure
from robot_ident.paper import printed
from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Array


@dataclass(frozen=True)
class TableI:
    """Names, meanings, units; printed and simulated values [21]."""

    names: tuple[str, ...]
    units: tuple[str, ...]
    simulated: Array

    @property
    def possible(self) -> bool:
        """Whether Izz3 >= |Ixx3 - Iyy3| holds, the triangle inequality of the moments of link 3."""
        values = dict(zip(self.names, self.simulated.tolist(), strict=True))
        return abs(values["p11"]) <= values["p15"]

    def to_dict(self) -> dict[str, Any]:
        """Return plain values."""
        return {
            "possible": self.possible,
            "parameters": [
                {"name": name, "meaning": meaning, "unit": unit, "printed": shown, "simulated": float(value)}
                for name, meaning, unit, shown, value in zip(
                    self.names, printed.MEANING, self.units, printed.TABLE_I, self.simulated, strict=True
                )
            ],
        }


def table_i(robot: Robot) -> TableI:
    """Return Table I of a robot of section IV."""
    structure = Structure.build(robot)
    return TableI(structure.names, tuple(one.unit for one in structure.parameters), structure.true_values())

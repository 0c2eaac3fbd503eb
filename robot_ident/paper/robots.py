"""The paper's robots: that of Table I as it is printed or made physically possible, beside the printed parameters, and
that of section V.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any
from xml.etree import ElementTree

from robot_ident.model.structure import Structure
from robot_ident.paper.printed import MEANING, PARAMETERS, TABLE_I
from robot_ident.robot import load_robot
from robot_ident.robot.robot import Definition, Robot
from robot_ident.robot.robot_file import definition_of, robot_of
from robot_ident.signals.motion import Array

FRICTION = (
    "stribeck@joint_1:stribeck=88,speed=0.03",
    "stribeck@joint_2:stribeck=59,speed=0.03",
    "stribeck@joint_3:stribeck=36,speed=0.03",
)
"""What the model of section V lacks here: friction that rises where a joint turns slowly. Its sizes leave the mean
squared residuals that the paper prints.
"""


def simulated_robot(printed_table: bool) -> Robot:
    """Return the robot of section IV: the nearest physically possible set to Table I, or the printed one.

    The printed one breaks p15 >= p11, that is Izz3 >= Ixx3 - Iyy3, which no distribution of mass can; the equation of
    motion holds all the same.
    """
    robot = load_robot("kuka_ir361")
    if not printed_table:
        return robot
    true = dict(zip(PARAMETERS, Structure.build(robot).true_values(), strict=True))
    wanted = dict(zip(PARAMETERS, TABLE_I, strict=True))
    missing = {name: wanted[name] - float(true[name]) for name in ("p1", "p11", "p15")}
    half = 0.5 * missing["p11"]
    changes = {
        "link_3": {"ixx": half, "iyy": -half, "izz": missing["p15"]},
        "link_1": {"izz": missing["p1"] + half},  # p1 holds Iyy3 too
    }
    known = definition_of(robot)
    urdf = ElementTree.fromstring(known.urdf)
    for link, parts in changes.items():
        inertia = urdf.find(f"link[@name='{link}']/inertial/inertia")
        assert inertia is not None
        for key, change in parts.items():
            inertia.set(key, repr(float(inertia.get(key, "0")) + change))
    return robot_of(Definition(known.yaml, ElementTree.tostring(urdf, encoding="unicode")), robot.source)


def robot_of_section_v() -> Robot:
    """Return the robot with the spring of axis 2 and torque offsets, both parts of its model: 25 parameters."""
    return load_robot("kuka_ir361_spring")


def without_known_effects(robot: Robot, *kept: str) -> Robot:
    """Return the robot as one whose model lacks its known effects, but for some of them."""
    return replace(robot, known_effects=tuple(label for label in robot.known_effects if label.split("@")[0] in kept))


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
                    self.names, MEANING, self.units, TABLE_I, self.simulated, strict=True
                )
            ],
        }


def table_i(robot: Robot) -> TableI:
    """Return Table I of a robot of section IV."""
    structure = Structure.build(robot)
    return TableI(structure.names, tuple(one.unit for one in structure.parameters), structure.true_values())

"""Tension spring that carries part of an arm's weight."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from robot_ident.effects.effect import Coefficient, Effect, Mathematics, Signals
from robot_ident.errors import InputError
from robot_ident.robot.robot import Robot


class GravitySpring(Effect):
    """A spring from a fixed point at distance L to a lever r on the link, stretched to d(q) = sqrt(L^2 + r^2 - 2 L r
    cos q).

    The drive carries L r sin(q) (k - k l0 / d(q)). The part with k alone has the column of gravity on the link and
    merges with its first moment; k l0 [kN] is the one new parameter, with column -1000 L r sin(q) / d(q).
    """

    name = "gravity_spring"
    equation = "-1000 k_l0 L r sin(q) / d(q), d = sqrt(L^2 + r^2 - 2 L r cos q)"
    meaning = "gravity spring, stiffness times free length"
    coefficients = (Coefficient("k_l0", "kN", "kN"),)
    symmetry = "conservative"
    loads_gear = True
    signature = "static in position"
    confused_with = ("cable",)
    experiment = "a wide range of this joint"

    def __init__(self, robot: Robot, joint: int, setting: Mapping[str, float] | None = None) -> None:
        """Read the spring's geometry from the robot; InputError where it has none."""
        super().__init__(robot, joint, setting)
        if robot.joints[joint] not in robot.springs:
            raise InputError(
                f"{self.label}: robot {robot.name} gives no geometry for it; add springs: {robot.joints[joint]}:"
                " {length: ..., lever: ...} to its YAML"
            )
        self.spring = robot.springs[robot.joints[joint]]

    def terms(self, x: Signals, m: Mathematics) -> Sequence[dict[int, Any]]:
        """Return -1000 L r sin(q) / d(q)."""
        length, lever, q = self.spring.length, self.spring.lever, x.q[self.joint]
        d = m.sqrt(length**2 + lever**2 - 2 * length * lever * m.cos(q))
        return [{self.joint: -1000.0 * length * lever * m.sin(q) / d}]

    def coefficient_values(self, truth: dict[str, float]) -> list[float]:
        """Return k l0 in kN."""
        return [truth["stiffness"] * truth["free_length"] / 1000.0]

    def absorbed(self, x: Signals, m: Mathematics, truth: dict[str, float]) -> dict[int, Any]:
        """Return k L r sin(q), which has the column of gravity on the link."""
        return {self.joint: truth["stiffness"] * self.spring.length * self.spring.lever * m.sin(x.q[self.joint])}

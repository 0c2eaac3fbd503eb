"""Tension spring that carries part of an arm's weight."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from robot_ident.effects.effect import Coefficient, Effect, Inner, Mathematics, Signals
from robot_ident.effects.rigid_arm import gravity_loads, spans_sine, upright
from robot_ident.robot.robot import Robot

_UPRIGHT = 0.1  # sine of the angle at q = 0 below which the link counts as upright


class GravitySpring(Effect):
    """A spring of stiffness k and free length l0 from a fixed point at distance L to a lever r on the link, at length
    d(q) = sqrt(L^2 + r^2 - 2 L r cos q).

    The drive carries L r sin(q) (k - k l0 / d(q)). Where the robot's YAML gives L and r the columns are 1000 L r sin(q)
    for k [kN/m] and -1000 L r sin(q) / d(q) for k l0 [kN]. Else rho = r / L is searched; the columns, which span the
    same, are sin(q) for r (k L - k l0) and sin(q) (1 - 1 / sqrt(1 + rho^2 - 2 rho cos q)) / rho for k l0 r^2 / L [Nm],
    what bends the law of a spring that is zero-length. Where sin(q) merges with gravity on the links (at a joint with
    a fixed horizontal axis) the second alone is left. Where the link is not upright at q = 0, q - `angle` stands for q,
    the angle at which it points straight at an anchor above or below its axis.
    """

    name = "gravity_spring"
    equation = "L r sin(q) (k - k_l0 / d(q)), d = sqrt(L^2 + r^2 - 2 L r cos q)"
    meaning = "gravity spring, stiffness times free length"
    coefficients: tuple[Coefficient, ...] = (
        Coefficient("k", "kN/m", "kN/m", positive=True),
        Coefficient("k_l0", "kN", "kN", positive=True),
    )
    inner = (Inner("ratio", "", "", 0.02, 0.95, (0.1, 0.2, 0.35, 0.5, 0.7), defining=True),)
    symmetry = "conservative"
    over_position = True
    loads_gear = True
    signature = "static in position, beyond gravity's sine"
    confused_with = ("cable", "base_tilt", "end_stop")
    experiment = "a slow sweep over the whole range of this joint: a spring bends where a cable stays straight"
    magnitude = "2-10 Nm beyond its linear law / none is usual"

    @classmethod
    def available(cls, robot: Robot, joint: int | None) -> str | None:
        """Carry the weight that loads a revolute joint."""
        if joint is None or robot.joints[joint] in robot.springs:
            return None
        if robot.prismatic[joint]:
            return "a prismatic joint has no such spring"
        return None if gravity_loads(robot.rigid, joint) else "gravity does not load this joint"

    def __init__(self, robot: Robot, joint: int | None, setting: Mapping[str, float] | None = None) -> None:
        """Read the spring's geometry from the robot, where it gives one, and leave out what merges with gravity."""
        super().__init__(robot, joint, setting)
        self.merges = spans_sine(robot.rigid, self.joint, self.setting.get("angle", 0.0))
        stiffness, rest = type(self).coefficients
        if self.spring is None:
            stiffness = Coefficient("net", "Nm", "N")
            rest = Coefficient("bend", "Nm", "N", positive=True)
        self.coefficients = (rest,) if self.merges else (stiffness, rest)

    @property
    def spring(self) -> Any:
        """Geometry of the spring, None where the robot gives none."""
        return self.robot.springs.get(self.robot.joints[self.joint])

    def placed_inner(self) -> tuple[Inner, ...]:
        """Search the ratio only where the geometry isn't known, the angle where the link isn't upright at zero."""
        if self.spring is not None:
            return ()
        up = None if self.whole else upright(self.robot.rigid, self.joint)
        if up is None or abs(np.sin(up)) < _UPRIGHT:
            return super().placed_inner()
        other = up - np.pi if up > 0.0 else up + np.pi
        return (*super().placed_inner(), Inner("angle", "rad", "rad", -np.pi, np.pi, (up, other), continuous=False))

    def full_terms(self, x: Signals, m: Mathematics) -> Sequence[dict[int, Any]]:
        """Return both columns."""
        q = x.q[self.joint] - self.setting.get("angle", 0.0)
        sine, cosine = m.sin(q), m.cos(q)
        if self.spring is None:
            ratio = self.setting["ratio"]
            stretch = m.sqrt(1 + ratio**2 - 2 * ratio * cosine)
            return [{self.joint: sine}, {self.joint: sine * (1 - 1 / stretch) / ratio}]
        length, lever = self.spring.length, self.spring.lever
        d = m.sqrt(length**2 + lever**2 - 2 * length * lever * cosine)
        arm = 1000.0 * length * lever * sine
        return [{self.joint: arm}, {self.joint: -arm / d}]

    @property
    def _kept(self) -> tuple[int, ...]:
        return (1,) if self.merges else (0, 1)

    def coefficient_values(self, truth: dict[str, float]) -> list[float]:
        """Return the coefficients of a spring with `stiffness` [N/m] and `free_length` [m]."""
        k, k_l0 = truth["stiffness"] / 1000.0, truth["stiffness"] * truth["free_length"] / 1000.0
        return [k_l0] if self.merges else [k, k_l0]

    def absorbed(self, x: Signals, m: Mathematics, truth: dict[str, float]) -> dict[int, Any]:
        """Return k L r sin(q) where it has the column of gravity on the links."""
        if not self.merges or self.spring is None:
            return {}
        return {self.joint: truth["stiffness"] * self.spring.length * self.spring.lever * m.sin(x.q[self.joint])}

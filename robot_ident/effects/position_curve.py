"""A smooth torque over a joint's position whose cause the catalogue does not know."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from robot_ident.effects.effect import Coefficient, Effect, Inner, Mathematics, Signals
from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Motion

_DEGREE = 5  # what bends less than a cable that tautens or one period of a sine


class PositionCurve(Effect):
    """A smooth curve over the joint's position between the ends of the recorded motion, constant beyond: tau = sum_k
    c_k P_k(x), x = -1 at `low` to 1 at `high`, P_k the Legendre polynomials of degree 0 to 5.

    It stands for causes that are none of the catalogue's own: a hose that tautens, a counterbalance of another law, a
    bearing that binds. It predicts motion in the same range and says nothing about the cause.
    """

    name = "position_curve"
    equation = "sum of c_k P_k(x), k = 0..5, x = -1 at low, 1 at high, P_k Legendre's polynomials"
    meaning = "smooth torque over position, of no known law"
    coefficients = tuple(Coefficient(f"c{k}", "Nm", "N") for k in range(_DEGREE + 1))
    inner = (
        Inner("low", "rad", "m", -100.0, 100.0, (-1.0,), continuous=False),
        Inner("high", "rad", "m", -100.0, 100.0, (1.0,), continuous=False),
    )
    symmetry = "conservative"
    over_position = True
    any_law = True
    signature = "static in position, of any smooth shape"
    confused_with = ("cable", "gravity_spring", "end_stop", "encoder_eccentricity", "torque_offset")
    experiment = "a slow sweep over the whole range of the joint shows the curve; look at what the link drags along"
    magnitude = "any"
    contains = {"torque_offset": "c0", "cable": "c1"}

    @classmethod
    def available(cls, robot: Robot, joint: int | None) -> str | None:
        """Sit on a joint whose position has limits."""
        return cls.no_end(robot, joint)

    def settings(self, motion: Motion | None = None) -> Sequence[dict[str, float]]:
        """Return the ends of a motion (of the joint's limits without one)."""
        if motion is None:
            lower, upper = self.robot.limits.lower[self.joint], self.robot.limits.upper[self.joint]
            return [{"low": float(lower), "high": float(upper)}]
        q = motion.q[:, self.joint]
        return [{"low": float(q.min()), "high": float(q.max())}] if q.min() < q.max() else []

    def full_terms(self, x: Signals, m: Mathematics) -> Sequence[dict[int, Any]]:
        """Return P_0 to P_5."""
        low, high = self.setting["low"], self.setting["high"]
        at = (2.0 * x.q[self.joint] - low - high) / (high - low)
        at = (m.fabs(at + 1.0) - m.fabs(at - 1.0)) / 2.0
        out = [1.0 + 0.0 * at, at]
        for k in range(1, _DEGREE):
            out.append(((2 * k + 1) * at * out[k] - k * out[k - 1]) / (k + 1))
        return [{self.joint: p} for p in out]

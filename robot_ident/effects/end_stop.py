"""Soft end stops."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from robot_ident.effects.effect import Coefficient, Effect, Inner, Mathematics, Signals, Torques
from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Array, Motion

_UPPER, _LOWER, _BOTH = 1.0, -1.0, 0.0
_INSETS = (0.04, 0.08, 0.13, 0.2, 0.27)  # of the range, from its end: further in nobody builds a stop
_DEEPEST = 0.4  # of the range from its end: what begins in the middle is a curve over position, not a stop


class EndStop(Effect):
    """A rubber stop or a hose that is stretched beyond a position `start`: tau = k max(0, q - start) at the upper end
    (`side` 1), -k max(0, start - q) at the lower one (side -1), both about the middle of the joint's range (side 0).
    """

    name = "end_stop"
    equation = "k max(0, q - start) (side 1), -k max(0, start - q) (side -1), both about the middle (side 0)"
    meaning = "soft end stop"
    coefficients = (Coefficient("stiffness", "Nm/rad", "N/m", positive=True),)
    inner = (
        Inner("side", "", "", -1.0, 1.0, (_UPPER, _LOWER, _BOTH), continuous=False),
        Inner("start", "rad", "m", -7.0, 7.0, (0.2, 0.5, 0.8, 1.1, 1.4)),
    )
    symmetry = "conservative"
    over_position = True
    signature = "static in position, one-sided"
    confused_with = ("cable", "gravity_spring")
    experiment = "two motions that both reach the end: a stop acts beyond one position alone"
    magnitude = "15-120 / 2-20 Nm/rad"

    @classmethod
    def available(cls, robot: Robot, joint: int | None) -> str | None:
        """Sit on a joint whose position has limits."""
        return cls.no_end(robot, joint)

    def placed_inner(self) -> tuple[Inner, ...]:
        """Look for the stop within the joint's limits, where it has some."""
        side, start = super().placed_inner()
        lower, upper = self._limits()
        grid = tuple(round(upper - inset * (upper - lower), 12) for inset in _INSETS)
        return side, replace(start, lower=lower, upper=upper, grid=grid)

    def settings(self, motion: Motion | None = None) -> Sequence[dict[str, float]]:
        """Return starts within the range of a motion (of the joint's limits without one)."""
        lower, upper = self._limits()
        if motion is not None:
            q = motion.q[:, self.joint]
            lower, upper = (float(end) for end in np.clip([q.min(), q.max()], lower, upper))
        span = upper - lower
        reach = min(upper - self.middle, self.middle - lower)
        above = [(_UPPER, upper - inset * span) for inset in _INSETS]
        below = [(_LOWER, lower + inset * span) for inset in _INSETS]
        both = [(_BOTH, self.middle + (1 - 2 * inset) * reach) for inset in _INSETS] if reach > 0 else []
        return [{"side": side, "start": start} for side, start in (*above, *below, *both)]

    def contradicts_itself(
        self, values: Array, along: Sequence[tuple[Motion, Torques]], beside: Mapping[str, float]
    ) -> bool:
        """Return whether it would begin about the middle of the joint's range."""
        lower, upper = self._limits()
        start, side = self.setting["start"], self.setting["side"]
        room = {_UPPER: upper - start, _LOWER: start - lower}.get(side, upper - self.middle - abs(start - self.middle))
        return bool(room > _DEEPEST * (upper - lower))

    def full_terms(self, x: Signals, m: Mathematics) -> Sequence[dict[int, Any]]:
        """Return the stretch beyond the start, with its sign."""
        q, side, start = x.q[self.joint], self.setting["side"], self.setting["start"]
        reach = abs(start - self.middle)
        top = start if side == _UPPER else self.middle + reach
        bottom = start if side == _LOWER else self.middle - reach
        above = (m.fabs(q - top) + (q - top)) / 2
        below = (m.fabs(bottom - q) + (bottom - q)) / 2
        return [{self.joint: (side != _LOWER) * above - (side != _UPPER) * below}]

    @property
    def middle(self) -> float:
        """Middle of the joint's range."""
        lower, upper = self._limits()
        return (lower + upper) / 2

    def _limits(self) -> tuple[float, float]:
        lower, upper = self.robot.limits.lower[self.joint], self.robot.limits.upper[self.joint]
        return float(lower), float(upper)

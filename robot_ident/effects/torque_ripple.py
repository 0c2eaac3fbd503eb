"""Torque that ripples with the motor's turns."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from robot_ident.effects.effect import Coefficient, Effect, Inner, Mathematics, Signals
from robot_ident.signals.motion import Array, Motion
from robot_ident.signals.order_spectrum import order_gains, order_near, predicted_by_halves, without_lines

_CYCLES = 3.0  # of a line within the joint's travel; fewer are a smooth curve over its position
_SLOW = 0.2  # of the rows, in which a line must lie within the band
_MOST = 1500  # orders that are looked at
_TRIED = 3  # lines that are tried, the highest
_SHARE = 0.02  # of the square of what is left that a line must hold to be certain
_CLEAR = 4.0  # by how much more than the highest of as many lines of noise the fall must be, in units of its variance


def order_of_a_line(*usual: float) -> Inner:
    """Return the order as a parameter inside a column, with its usual values."""
    return Inner("h", "", "1/m", 0.5, 1e5, usual, continuous=False)


class TorqueRipple(Effect):
    """Cogging, current-sensor and gear ripple in step with the motor's angle n q, n the gear ratio: tau = a cos(h n q)
    + b sin(h n q), the strongest line of it.

    h = 2 is a strain-wave gear's wave generator, h = 1 an eccentric motor, the number of pole pairs and its multiples a
    magnet's or a winding's; it is read off the spectrum of what a model leaves, over the angle. Without a declared gear
    ratio n = 1: h counts the lines of a turn of the joint. Behind the gear the drive's own ripple doesn't show, but
    that of strain gauges on a flexspline does, which the wave generator bends.
    """

    name = "torque_ripple"
    equation = "a cos(h n q) + b sin(h n q), n the gear ratio"
    meaning = "torque ripple of motor and gear"
    coefficients = (Coefficient("cos", "Nm", "N"), Coefficient("sin", "Nm", "N"))
    inner = (order_of_a_line(0.5, 1.0, 2.0, 4.0),)
    symmetry = "conservative"
    signature = "lines whose frequency moves with speed"
    also_like = ("a disturbance of fixed frequency",)
    confused_with = ("encoder_eccentricity",)
    experiment = "two speeds: ripple's frequency follows the speed, a disturbance's stays"
    magnitude = "1-6 / 0.1-1 Nm"

    def settings(self, motion: Motion | None = None) -> Sequence[dict[str, float]]:
        """Return the usual lines of a geared motor; none where they are to be read off the spectrum."""
        return super().settings(motion) if self.geared and not self.after else []

    @property
    def ratio(self) -> float:
        """Turns of what its orders count, for each turn of the joint."""
        return float(self.robot.drives.gear_ratio[self.joint])

    @property
    def geared(self) -> bool:
        """Whether the gear ratio is declared, so that orders count a turn of the motor."""
        return self.ratio != 1.0

    def orders(self, motion: Motion, fastest: float) -> Array:
        """Return the orders [H] that a motion can show below a frequency [Hz]: whole ones of a motor or of a joint that
        turns round, any of a joint that does not.
        """
        ratio, travel = self.ratio, self._travel(motion)
        speed = np.abs(motion.dq[:, self.joint])
        if not travel or not speed.any():
            return np.zeros(0)
        lowest = 2.0 * np.pi * _CYCLES / (ratio * travel)
        highest = 2.0 * np.pi * fastest / (ratio * float(np.quantile(speed[speed > 0.0], _SLOW)))
        whole = self.whole_orders(motion)
        step = self.resolution(motion) or 1.0
        first = max(1.0, np.ceil(lowest)) if whole else lowest
        return np.asarray(np.arange(first, min(highest, first + _MOST * step) + 1e-9, step))

    def _travel(self, motion: Motion) -> float:
        return float(np.ptp(motion.q[:, self.joint]))

    def whole_orders(self, motion: Motion) -> bool:
        """Return whether only whole orders have a meaning: of a motor, or of a joint that turns round twice."""
        return self.geared or self._travel(motion) > 4.0 * np.pi

    def resolution(self, motion: Motion) -> float:
        """Return by how much an order may be off that is read off: a quarter of a cycle over the travel; 0 where only
        whole orders have a meaning.
        """
        travel = self._travel(motion)
        return 0.0 if self.whole_orders(motion) or not travel else 0.5 * np.pi / (self.ratio * travel)

    def lines(self, motion: Motion, left: Array, fastest: float, together: float = 0.0) -> list[float]:
        """Return the orders of the highest lines of what a model leaves of the joint [N], over its angle: each of what
        the ones before leave; none where they can't hold a share of it `together`.
        """
        orders, angle = self.orders(motion, fastest), self.ratio * motion.q[:, self.joint]
        out: list[float] = []
        if not len(orders):
            return out
        apart = self.resolution(motion)
        least, rest = 2.0 * np.log(len(orders)) + _CLEAR, left
        while len(out) < _TRIED and np.any(rest):
            gains = order_gains(angle, rest, orders)
            if np.max(gains) <= least * np.mean(rest**2):
                break
            if not out and _TRIED * np.max(gains) < together * left @ left:  # no later one is higher
                break
            out.append(float(orders[np.argmax(gains)]))
            for k in range(len(out)) if apart else ():  # each beside the others
                others = without_lines(angle, left, [*out[:k], *out[k + 1 :]])
                out[k] = order_near(angle, others, out[k], apart)
            rest = without_lines(angle, left, out)
        return out

    def certain_lines(self, motion: Motion, left: Array, fastest: float, together: float = 0.0) -> dict[float, float]:
        """Return the orders of the highest lines that either half of the rows predicts of the other, each with the
        fall of the squared error by it; those that hold little of what is left [N] are none of them, and none is where
        all do not hold a share of it `together`.
        """
        left, angle = left - left.mean(), self.ratio * motion.q[:, self.joint]
        falls = {h: predicted_by_halves(angle, left, h) for h in self.lines(motion, left, fastest, together)}
        falls = {h: fall for h, fall in falls.items() if fall > _SHARE * left @ left}
        return falls if sum(falls.values()) >= together * left @ left else {}

    def full_terms(self, x: Signals, m: Mathematics) -> Sequence[dict[int, Any]]:
        """Return cos(h n q) and sin(h n q)."""
        angle = self.setting["h"] * self.ratio * x.q[self.joint]
        return [{self.joint: m.cos(angle)}, {self.joint: m.sin(angle)}]

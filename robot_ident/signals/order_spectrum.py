"""Lines of a signal over an angle: how much of it follows a cos(h angle) + b sin(h angle), by order h."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from robot_ident.signals.motion import Array

_AT_ONCE = 2_000_000  # numbers
_ABOUT = 9  # orders about one at which the highest line is looked for at first


def order_gains(angle: Array, signal: Array, orders: Array) -> Array:
    """Return the fall [H] of the squared error of a signal [N] by one line over the angle [N] rad, order [H] by order.

    The orders need not be even, nor the angle: each line is fitted by least squares (Lomb 1976).
    """
    out = np.zeros(len(orders))
    for part in np.array_split(np.arange(len(orders)), 1 + len(orders) * len(angle) // _AT_ONCE):
        turned = np.outer(angle, orders[part])
        c, s = np.cos(turned), np.sin(turned)
        cc, ss, cs = np.sum(c * c, axis=0), np.sum(s * s, axis=0), np.sum(c * s, axis=0)
        c, s = signal @ c, signal @ s
        determinant = cc * ss - cs**2
        seen = determinant > 1e-6 * cc * ss
        gain = (ss * c**2 - 2.0 * cs * c * s + cc * s**2) / np.where(seen, determinant, 1.0)
        out[part] = np.where(seen, gain, 0.0)
    return out


def order_near(angle: Array, signal: Array, order: float, apart: float) -> float:
    """Return the order within `apart` of one at which the line of a signal [N] over an angle [N] is highest."""
    from scipy.optimize import minimize_scalar

    about = order + apart * np.linspace(-1.0, 1.0, _ABOUT)
    best = int(np.argmax(order_gains(angle, signal, about)))
    found = minimize_scalar(
        lambda h: -float(order_gains(angle, signal, np.array([h]))[0]),
        bounds=(about[max(best - 1, 0)], about[min(best + 1, _ABOUT - 1)]),
        method="bounded",
        options={"xatol": 1e-3 * apart},
    )
    return float(found.x)


def without_lines(angle: Array, signal: Array, orders: Sequence[float]) -> Array:
    """Return a signal [N] less its lines of some orders, fitted together by least squares."""
    if not len(orders):
        return signal
    turned = np.outer(angle, orders)
    columns = np.hstack([np.cos(turned), np.sin(turned)])
    return np.asarray(signal - columns @ np.linalg.lstsq(columns, signal, rcond=None)[0])


def predicted_by_halves(angle: Array, signal: Array, order: float) -> float:
    """Return the fall of a signal's squared error by its line of an order, fitted to the other half of the rows [N]."""
    columns = np.column_stack([np.cos(order * angle), np.sin(order * angle)])
    halves = np.array_split(np.arange(len(signal)), 2)
    after = 0.0
    for fitted, judged in (halves, halves[::-1]):
        line = np.linalg.lstsq(columns[fitted], signal[fitted], rcond=None)[0]
        after += float(np.sum((signal[judged] - columns[judged] @ line) ** 2))
    return float(signal @ signal) - after

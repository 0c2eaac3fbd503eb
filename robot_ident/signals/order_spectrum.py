"""Lines of a signal over an angle: how much of it follows a cos(h angle) + b sin(h angle), by order h."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from robot_ident.signals.motion import Array

_BLOCK = 40  # orders whose lines are turned into one another: for all others a product of two does
_AT_ONCE = 2_000_000  # numbers
_ABOUT = 9  # orders about one at which the highest line is looked for at first


def order_gains(angle: Array, signal: Array, orders: Array) -> Array:
    """Return the fall [H] of the squared error of a signal [N] by one line over the angle [N] rad, order [H] by order.

    The orders are even (one is enough), the angle need not be: each line is fitted by least squares (Lomb 1976). Its
    normal equations have the sums of e^(i h angle) signal and of e^(2 i h angle).
    """
    count = len(orders)
    step = (orders[-1] - orders[0]) / (count - 1) if count > 1 else 0.0
    block = max(1, min(_BLOCK, count, _AT_ONCE // len(angle)))
    turned = np.exp(1j * np.outer(angle, step * np.arange(block)))
    told, twice = np.empty((2, count), dtype=complex)
    square = turned**2
    for at in range(0, count, block):
        first, size = np.exp(1j * orders[at] * angle), min(block, count - at)
        told[at : at + size] = (first * signal) @ turned[:, :size]
        twice[at : at + size] = first**2 @ square[:, :size]
    cc, ss, cs = (len(angle) + twice.real) / 2.0, (len(angle) - twice.real) / 2.0, twice.imag / 2.0
    c, s = told.real, told.imag
    determinant = cc * ss - cs**2
    seen = determinant > 1e-6 * cc * ss
    gain = (ss * c**2 - 2.0 * cs * c * s + cc * s**2) / np.where(seen, determinant, 1.0)
    return np.where(seen, gain, 0.0)


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

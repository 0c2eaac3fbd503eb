"""Lines of a signal over an angle: how much of it follows a cos(h angle) + b sin(h angle), by order h."""

from __future__ import annotations

import numpy as np

from robot_ident.signals.motion import Array

_AT_ONCE = 2_000_000  # numbers


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


def without_line(angle: Array, signal: Array, order: float) -> Array:
    """Return a signal [N] less its line of an order, fitted by least squares."""
    columns = np.column_stack([np.cos(order * angle), np.sin(order * angle)])
    return np.asarray(signal - columns @ np.linalg.lstsq(columns, signal, rcond=None)[0])

"""Which inequality a set of parameters breaks that no arm can break, in words."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from robot_ident.estimation.driving import POSITIVE
from robot_ident.estimation.pseudo_inertia import PLACE
from robot_ident.estimation.semidefinite import Nearest
from robot_ident.model.structure import Structure
from robot_ident.signals.motion import Array

NEAR = 1e-3
"""Fall of chi-square, below which parameters count as possible."""

_SECOND = {"x": (("Iyy", "Izz"), "Ixx"), "y": (("Ixx", "Izz"), "Iyy"), "z": (("Ixx", "Iyy"), "Izz")}


def violations(structure: Structure, values: Array) -> tuple[str, ...]:
    """Return the inequalities that linear parameters [p] break, in words; empty where they are physically possible.

    Signs of friction and rotor inertia; for each link the sums of moments of inertia that base parameters express; and,
    where none of these is broken but no links can give the parameters, the plane that separates them from what can be.
    """
    broken = [f"{structure.names[k]} = {values[k]:.4g} is negative" for k in never_negative(structure) if values[k] < 0]
    broken += _broken_moments(structure, values)
    if broken:
        return tuple(broken)
    scale = np.maximum(np.abs(values), 0.01 * float(np.abs(values).max()))
    metric = np.diag((0.01 * scale) ** 2)
    program = Nearest.of(structure, values, metric, never_negative(structure))
    step = program.to(values)[1] - values
    if program.squared_distance(step) < NEAR:
        return ()
    return (separating(structure, values, program.normal(step)),)


def _broken_moments(structure: Structure, values: Array) -> list[str]:
    """Return the links whose second moment along an axis is negative, where base parameters alone tell it."""
    base, n = structure.base, structure.robot.n
    own = values[: len(base.columns)]
    out = []
    for link in range(n):
        for axis, (others, minus) in _SECOND.items():
            moment = np.zeros(11 * n)
            for name in others:
                moment[10 * link + PLACE[name]] = 1.0
            moment[10 * link + PLACE[minus]] = -1.0
            weights, *_ = np.linalg.lstsq(base.regrouping.T, moment, rcond=None)
            weights[np.abs(weights) < 1e-9] = 0.0
            if np.abs(base.regrouping.T @ weights - moment).max() > 1e-9 or weights @ own >= 0:
                continue
            left = _sum(base.names, np.where(weights > 0, weights, 0.0))
            right = _sum(base.names, np.where(weights < 0, -weights, 0.0))
            sizes = float(np.maximum(weights, 0) @ own), float(np.maximum(-weights, 0) @ own)
            out.append(
                f"{left} >= {right} does not hold: {sizes[0]:.4g} < {sizes[1]:.4g} (second moment of link {link + 1}"
                f" along {axis}, {others[0]} + {others[1]} - {minus}, is negative)"
            )
    return out


def separating(structure: Structure, values: Array, normal: Array) -> str:
    """Return the plane through zero, with a normal [p], between parameters and the cone of possible ones, in words."""
    share = normal * values
    order = [k for k in np.argsort(-np.abs(share)) if abs(share[k]) > 0.02 * np.abs(share).max()][:6]
    normal = normal / np.abs(normal[order]).max()
    words = _sum([structure.names[k] for k in order], normal[order])
    return f"no links can give {words} = {float(normal @ values):.3g}: it must not be negative"


def _sum(names: Sequence[str], weights: Array) -> str:
    words: list[str] = []
    for name, weight in zip(names, weights, strict=True):
        if weight == 0.0:
            continue
        factor = "" if abs(abs(weight) - 1.0) < 1e-9 else f"{abs(weight):.3g} "
        sign = "- " if weight < 0 else ("+ " if words else "")
        words.append(f"{sign}{factor}{name}")
    return " ".join(words) or "0"


def never_negative(structure: Structure) -> list[int]:
    """Return which linear parameters have no meaning below zero."""
    return [
        own.start + k
        for effect, own in structure.placed
        for k, coefficient in enumerate(effect.coefficients)
        if coefficient.positive or effect.name in POSITIVE
    ]

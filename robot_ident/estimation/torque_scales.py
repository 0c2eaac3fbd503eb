"""The scales in which joints report their torque, found together with the parameters that the joints share."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from robot_ident.effects.torque_scale import SPREAD, TorqueScale
from robot_ident.estimation.equations import Equations
from robot_ident.estimation.least_squares import held_softly
from robot_ident.estimation.problem import Problem
from robot_ident.model.structure import Structure
from robot_ident.signals.motion import Array

_ROUNDS = 30
_STEP = 0.3  # of ln a, in one round
_SETTLED = 1e-8  # of ln a, between rounds


def with_scales(problem: Problem, structure: Structure) -> Structure:
    """Return a structure at its most likely torque scales, by Gauss-Newton on theta and ln a, ln a ~ N(0, SPREAD^2)."""
    joints = structure.scaled
    if not joints:
        return structure
    theta, _, equations = problem.linear(structure)
    scales = structure.scales
    b = len(structure.base.columns)
    alone = equations.phi[:, :b] / scales[equations.joint][:, None]
    own = equations.phi[:, b:]
    places = np.array(joints)
    for _ in range(_ROUNDS):
        factor = scales[equations.joint]
        links = factor * (alone @ theta[:b])
        jacobian = np.hstack([factor[:, None] * alone, own, by_scale(equations, links, joints)])
        residual = equations.torque - links - own @ theta[b:]
        white, right = problem.noise.weigh(jacobian), problem.noise.weigh(residual)
        step = held_softly(white, right, -np.log(scales[places]), SPREAD)
        change = np.clip(step[len(theta) :], -_STEP, _STEP)
        theta = theta + step[: len(theta)]
        scales[places] *= np.exp(change)
        if np.abs(change).max() < _SETTLED:
            break
    return at_scales(structure, scales)


def by_scale(equations: Equations, links: Array, joints: tuple[int, ...]) -> Array:
    """Return the derivatives [R, k] of the torque by ln a of each joint, for the links' torque [R] as reported."""
    return np.column_stack([np.where(equations.joint == joint, links, 0.0) for joint in joints])


def at_scales(structure: Structure, scales: Array) -> Structure:
    """Return a structure whose torque scales are those of its joints among scales [n]."""
    effects = [
        effect.at({"scale": float(np.clip(scales[effect.joint], effect.inner[0].lower, effect.inner[0].upper))})
        if isinstance(effect, TorqueScale)
        else effect
        for effect in structure.effects
    ]
    return replace(structure, effects=tuple(effects))

"""Semidefinite programs over the inertias of links, solved by Clarabel.

Variables are scaled: masses in units of the link's own, moments besides in powers of its length.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from robot_ident.errors import InputError
from robot_ident.estimation.pseudo_inertia import IDENTITY, LEAST, LENGTH, TRIANGLE
from robot_ident.model.structure import Structure
from robot_ident.signals.motion import Array

_PRIOR = 1e-4  # weight, in chi-square, of staying near the URDF's inertias where the torque does not tell
_HEAVIER = 0.1  # of a base parameter in units of the link: it may hold what several links carry
_UNITS = (1.0, 30.0, 1e3, 3e4)  # standard deviations in which distances are counted, the next where the solver fails
_SHARPEST = 1e-8  # of the covariance's largest direction: few data make others look far too well known


def inertial_scale(structure: Structure, base: Array) -> Array:
    """Return units [11 n] of the standard parameters of every link and of the rotor inertias.

    A link's mass is the URDF's, or what its base parameters [b] make of it where the URDF has no real masses.
    """
    mass = np.maximum(structure.robot.rigid.parameters[::10], 1.0)
    unit = np.array([1.0] + [LENGTH] * 3 + [LENGTH**2] * 6)
    for column, value in zip(structure.base.columns, base, strict=True):
        link = column // 10
        mass[link] = max(mass[link], _HEAVIER * abs(float(value)) / unit[column % 10])
    return np.concatenate([np.kron(mass, unit), mass * LENGTH**2])


@dataclass(frozen=True)
class Nearest:
    """The possible parameters nearest to a point, in the metric of a covariance.

    min |y|^2 + prior |z - z0|^2 with y = C^-1/2 (G S z - theta), pseudo-inertias of S z positive definite, rotors and
    what else has no meaning below zero not negative. gather G [p, m]; scale S [m]; start z0 [m]; whiten C^-1/2 [p, p];
    positive: places in z that must not be negative. All points share the constraints: only the target moves.
    """

    gather: Array
    scale: Array
    start: Array
    whiten: Array
    positive: np.ndarray[Any, np.dtype[np.int64]]
    links: int

    @classmethod
    def of(cls, structure: Structure, values: Array, covariance: Array, never_negative: list[int]) -> Nearest:
        """Return the program about linear parameters [p]; `never_negative`: which of them have no sense below zero."""
        robot, base = structure.robot, structure.base
        n, p, b = robot.n, len(values), len(base.columns)
        gather = np.zeros((p, 11 * n + p - b))
        gather[:b, : 11 * n] = base.regrouping
        gather[b:, 11 * n :] = np.eye(p - b)
        scale = np.concatenate([inertial_scale(structure, values[:b]), np.maximum(np.abs(values[b:]), 1.0)])
        start = np.concatenate([robot.rigid.parameters, robot.drives.armature, values[b:]])
        size = np.sqrt(np.diag(covariance))
        if not np.all(size > 0):
            unknown = structure.names[int(np.argmin(size))]
            raise InputError(
                f"the variance of {unknown} is zero; nothing can be near to parameters without uncertainty"
            )
        power, vectors = np.linalg.eigh(covariance / np.outer(size, size))
        whiten = (vectors / np.sqrt(np.maximum(power, _SHARPEST * power[-1]))).T / size
        positive = np.array([*range(10 * n, 11 * n), *(11 * n + k - b for k in never_negative)])
        return cls(gather, scale, start / scale, whiten, positive, n)

    def squared_distance(self, step: Array) -> float:
        """Return step' C^-1 step, the rise of chi-square on a step [p] from the estimate."""
        return float(np.sum((self.whiten @ step) ** 2))

    def normal(self, step: Array) -> Array:
        """Return C^-1 step [p]: of the plane between a point and the cone, for the step to the nearest point of it."""
        return np.asarray(self.whiten.T @ (self.whiten @ step))

    def to(self, values: Array) -> tuple[Array, Array]:
        """Return (standard inertias, rotors and further parameters [m], linear parameters [p]) nearest to `values`.

        Raises InputError where the solver doesn't converge.
        """
        m, p = len(self.scale), len(values)
        # what has a parameter of its own needs no prior
        own = np.arange(m) < 11 * self.links
        quadratic = np.concatenate([2.0 * _PRIOR * own, np.full(p, 2.0)])
        linear = np.concatenate([-2.0 * _PRIOR * own * self.start, np.zeros(p)])
        signs = np.zeros((len(self.positive), m + p))
        signs[np.arange(len(self.positive)), self.positive] = -1.0
        links, floors = pseudo_inertia_rows(self.scale, np.eye(10 * self.links, m + p), np.zeros(10 * self.links))
        floors = np.concatenate([np.zeros(len(self.positive)), floors])
        for unit in _UNITS:
            whiten = self.whiten / unit
            a = np.vstack([np.hstack([whiten @ self.gather * self.scale, -np.eye(p)]), signs, links])
            b = np.concatenate([whiten @ values, floors])
            try:
                z = solve(np.diag(quadratic), linear, a, b, zero=p, positive=len(self.positive), links=self.links)
                break
            except InputError:
                if unit == _UNITS[-1]:
                    raise
        z = z[:m]
        z[self.positive] = np.maximum(z[self.positive], 0.0)  # exactly, not as nearly as the solver ends
        x = z * self.scale
        return x, self.gather @ x


def pseudo_inertia_rows(scale: Array, slope: Array, offset: Array, least: float = LEAST) -> tuple[Array, Array]:
    """Return A and b of A v + s = b, s in the cones, for scaled standard parameters z = slope v + offset [10 n].

    The floor `least` under the eigenvalues is that of a link of unit mass in units of the link's own.
    """
    rows, rights = [], []
    for first in range(0, len(slope), 10):
        own = slice(first, first + 10)
        rows.append(-TRIANGLE @ slope[own])
        rights.append(TRIANGLE @ offset[own] - least / scale[first] * IDENTITY)
    return np.vstack(rows), np.concatenate(rights)


def solve(quadratic: Array, linear: Array, a: Array, b: Array, *, zero: int, positive: int, links: int) -> Array:
    """Minimise v' P v / 2 + q' v with b - A v zero in the first rows, positive in the next, then pseudo-inertias.

    Raises InputError where the solver doesn't converge.
    """
    import clarabel  # type: ignore[import-untyped]
    from scipy import sparse

    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.max_iter = 200
    cones = [clarabel.ZeroConeT(zero)] if zero else []
    cones += [clarabel.NonnegativeConeT(positive), *(clarabel.PSDTriangleConeT(4) for _ in range(links))]
    matrices = sparse.csc_matrix(sparse.triu(quadratic)), sparse.csc_matrix(a)
    answer = clarabel.DefaultSolver(matrices[0], linear, matrices[1], b, cones, settings).solve()
    if str(answer.status) not in ("Solved", "AlmostSolved"):
        raise InputError(
            f"no physically consistent parameters were found (the solver says {answer.status}): the estimate lies too"
            " far from any that links can have; look at what the model lacks first (robot_ident diagnose)"
        )
    return np.array(answer.x)

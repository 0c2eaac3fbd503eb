"""Parameters that a real arm can have: the nearest with every pseudo-inertia positive definite.

A link with mass m, first moment h and inertia I about its frame is a body of non-negative density exactly when the
pseudo-inertia [[Sigma, h], [h', m]], Sigma = tr(I) / 2 - I, is positive semidefinite (Wensing, Kim and Slotine, "Linear
matrix inequalities for physically consistent inertial parameter identification", 2018). Base parameters are possible
when some standard inertias give them. The nearest ones, in the metric of the estimate's own covariance, solve a
semidefinite program (Clarabel), which yields standard inertias for all links with them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from robot_ident.errors import InputError
from robot_ident.estimation.problem import Solution
from robot_ident.model.structure import Structure
from robot_ident.motion import Array

_LEAST = 1e-5  # smallest eigenvalue of a pseudo-inertia, kg and kg m^2
_PRIOR = 1e-4  # weight, in chi-square, of staying near the URDF's inertias where the torque does not tell
_LENGTH = 0.3  # m, the size of a link, which scales its moments
_NEAR = 1e-3  # fall of chi-square, below which parameters count as possible
_POSITIVE = ("viscous", "coulomb", "rotor_inertia")
_SECOND = {"x": (("Iyy", "Izz"), "Ixx"), "y": (("Ixx", "Izz"), "Iyy"), "z": (("Ixx", "Iyy"), "Izz")}
_PLACES = {"Ixx": 4, "Ixy": 5, "Iyy": 6, "Ixz": 7, "Iyz": 8, "Izz": 9}


@dataclass(frozen=True)
class Consistent:
    """Physically consistent parameters.

    solution: with them in place of the estimate. inertias [10 n]: standard parameters of the links that give them,
    rotors [n] kg m^2. distance: sqrt of the rise of chi-square. violated: what the estimate broke.
    """

    solution: Solution
    inertias: Array
    rotors: Array
    distance: float
    residual_rise: float
    violated: tuple[str, ...]

    @property
    def notes(self) -> tuple[str, ...]:
        """What happened, in a line or two."""
        if not self.violated:
            return ("the parameters are physically possible as estimated",)
        return (
            *(f"not physically possible as estimated: {one}" for one in self.violated),
            f"nearest possible parameters taken: {self.distance:.3g} standard deviations away (chi-square"
            f" +{self.distance**2:.3g}), mean squared residual {100 * self.residual_rise:+.2g} %",
        )

    def to_dict(self) -> dict[str, Any]:
        """Return plain data for `model.yaml`."""
        robot = self.solution.structure.robot
        return {
            "distance": self.distance,
            "residual_rise": self.residual_rise,
            "violated": list(self.violated),
            "inertias": {
                name: dict(zip(("m", "mx", "my", "mz", *_PLACES), map(float, row), strict=True))
                for name, row in zip(robot.joints, self.inertias.reshape(robot.n, 10), strict=True)
            },
            "rotor_inertia": dict(zip(robot.joints, map(float, self.rotors), strict=True)),
        }


def nearest_physical(found: Solution) -> Consistent:
    """Return the physically consistent parameters nearest to an estimate, in the metric of its covariance.

    The covariance is left as it is: it is that of the data, which what is possible can only make smaller.
    Raises InputError where the solver is not installed or doesn't converge.
    """
    structure = found.structure
    p = len(structure.parameters)
    estimate, covariance = found.values[:p], found.covariance[:p, :p]
    x, values = _nearest(structure, estimate, covariance)
    step = values - estimate
    rise = float(step @ np.linalg.solve(covariance, step))
    n = structure.robot.n
    equations = found.equations
    before = equations.torque - equations.phi @ estimate
    after = equations.torque - equations.phi @ values
    violated = violations(structure, estimate)
    if rise > _NEAR and not violated:
        violated = (_separating(structure, estimate, covariance, step),)
    return Consistent(
        solution=replace(
            found,
            values=np.concatenate([values, found.values[p:]]),
            chi_square=found.chi_square + rise,
        ),
        inertias=x[: 10 * n],
        rotors=x[10 * n : 11 * n] * structure.base.regrouping[:, 10 * n :].any(axis=0)
        + _free_rotors(structure, values),
        distance=float(np.sqrt(max(rise, 0.0))),
        residual_rise=float(np.sum(after**2) / np.sum(before**2) - 1.0),
        violated=violated,
    )


def violations(structure: Structure, values: Array) -> tuple[str, ...]:
    """Return the inequalities that linear parameters [p] break, in words; empty where they are physically possible.

    Signs of friction and rotor inertia; for each link the sums of moments of inertia that base parameters express; and,
    where none of these is broken but no links can give the parameters, the plane that separates them from what can be.
    """
    broken = [
        f"{structure.names[k]} = {values[k]:.4g} is negative" for k in _never_negative(structure) if values[k] < 0
    ]
    broken += _broken_moments(structure, values)
    if broken:
        return tuple(broken)
    scale = np.maximum(np.abs(values), 0.01 * float(np.abs(values).max()))
    metric = np.diag((0.01 * scale) ** 2)
    _, nearest = _nearest(structure, values, metric)
    step = nearest - values
    if float(step @ np.linalg.solve(metric, step)) < _NEAR:
        return ()
    return (_separating(structure, values, metric, step),)


def _broken_moments(structure: Structure, values: Array) -> list[str]:
    """Return the links whose second moment along an axis is negative, where base parameters alone tell it."""
    base, n = structure.base, structure.robot.n
    own = values[: len(base.columns)]
    out = []
    for link in range(n):
        for axis, (others, minus) in _SECOND.items():
            moment = np.zeros(11 * n)
            for name in others:
                moment[10 * link + _PLACES[name]] = 1.0
            moment[10 * link + _PLACES[minus]] = -1.0
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


def _separating(structure: Structure, values: Array, metric: Array, step: Array) -> str:
    """Return the plane through zero between a point and the cone of possible parameters: its normal is C^-1 step."""
    normal = np.linalg.solve(metric, step)
    share = normal * values
    order = [k for k in np.argsort(-np.abs(share)) if abs(share[k]) > 0.02 * np.abs(share).max()][:6]
    normal = normal / np.abs(normal[order]).max()
    words = _sum([structure.names[k] for k in order], normal[order])
    return f"no links can give {words} = {float(normal @ values):.3g}: it must not be negative"


def _sum(names: Any, weights: Array) -> str:
    words: list[str] = []
    for name, weight in zip(names, weights, strict=True):
        if weight == 0.0:
            continue
        factor = "" if abs(abs(weight) - 1.0) < 1e-9 else f"{abs(weight):.3g} "
        sign = "- " if weight < 0 else ("+ " if words else "")
        words.append(f"{sign}{factor}{name}")
    return " ".join(words) or "0"


def _never_negative(structure: Structure) -> list[int]:
    """Return which linear parameters have no meaning below zero."""
    out, place = [], len(structure.base.columns)
    for effect in structure.effects:
        for coefficient in effect.coefficients:
            if coefficient.positive or effect.name in _POSITIVE:
                out.append(place)
            place += 1
    return out


def _free_rotors(structure: Structure, values: Array) -> Array:
    out = np.zeros(structure.robot.n)
    for parameter, value in zip(structure.parameters, values, strict=True):
        if parameter.effect == "rotor_inertia" and parameter.joint is not None:
            out[structure.robot.joint_index(parameter.joint)] += value
    return out


def _nearest(structure: Structure, values: Array, covariance: Array) -> tuple[Array, Array]:
    """Return (standard inertias, rotors and further parameters [m], linear parameters [p]) of the nearest point."""
    try:
        import clarabel  # type: ignore[import-untyped]
    except ImportError as error:
        raise InputError("physical consistency needs the solver Clarabel: pip install clarabel") from error
    from scipy import sparse

    program = _Program.of(structure, values, covariance)
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.max_iter = 200
    cones = [
        clarabel.ZeroConeT(len(values)),
        clarabel.NonnegativeConeT(len(program.positive)),
        *(clarabel.PSDTriangleConeT(4) for _ in range(structure.robot.n)),
    ]
    a, b = program.constraints()
    p, q = program.objective()
    answer = clarabel.DefaultSolver(
        sparse.csc_matrix(sparse.triu(p)), q, sparse.csc_matrix(a), b, cones, settings
    ).solve()
    if str(answer.status) not in ("Solved", "AlmostSolved"):
        raise InputError(f"no physically consistent parameters were found: the solver says {answer.status}")
    x = np.array(answer.x[: len(program.scale)]) * program.scale
    return x, program.gather @ x


@dataclass(frozen=True)
class _Program:
    """min |y|^2 + prior |z - z0|^2, y = C^-1/2 (G S z - theta), pseudo-inertias of S z positive definite, some z >= 0.

    gather G [p, m]; scale S [m]; positive: places of x that must not be negative.
    """

    gather: Array
    scale: Array
    start: Array
    whiten: Array
    target: Array
    positive: np.ndarray
    links: int

    @classmethod
    def of(cls, structure: Structure, values: Array, covariance: Array) -> _Program:
        robot, base = structure.robot, structure.base
        n, p, b = robot.n, len(values), len(base.columns)
        gather = np.zeros((p, 11 * n + p - b))
        gather[:b, : 11 * n] = base.regrouping
        gather[b:, 11 * n :] = np.eye(p - b)
        mass = np.maximum(robot.rigid.parameters[::10], 1.0)
        unit = np.array([1.0] + [_LENGTH] * 3 + [_LENGTH**2] * 6)
        scale = np.concatenate([np.kron(mass, unit), mass * _LENGTH**2, np.maximum(np.abs(values[b:]), 1.0)])
        start = np.concatenate([robot.rigid.parameters, robot.drives.armature, values[b:]])
        positive = [11 * n + k - b for k in _never_negative(structure)]
        size = np.sqrt(np.diag(covariance))
        root = np.linalg.cholesky(covariance / np.outer(size, size))
        whiten = np.linalg.inv(root) / size
        return cls(
            gather, scale, start / scale, whiten, whiten @ values, np.array([*range(10 * n, 11 * n), *positive]), n
        )

    def objective(self) -> tuple[Array, Array]:
        """Return P and q of 1/2 v'P v + q'v for v = [z, y]."""
        m, p = len(self.scale), len(self.target)
        # what has a parameter of its own needs no prior
        own = np.arange(m) < 11 * self.links
        quadratic = np.diag(np.concatenate([2.0 * _PRIOR * own, np.full(p, 2.0)]))
        return quadratic, np.concatenate([-2.0 * _PRIOR * own * self.start, np.zeros(p)])

    def constraints(self) -> tuple[Array, Array]:
        """Return A and b of A v + s = b, s in the cones."""
        m, p = len(self.scale), len(self.target)
        equal = np.hstack([self.whiten @ self.gather * self.scale, -np.eye(p)])
        signs = np.zeros((len(self.positive), m + p))
        signs[np.arange(len(self.positive)), self.positive] = -1.0
        blocks, rights = [equal, signs], [self.target, np.zeros(len(self.positive))]
        for link in range(self.links):
            rows = np.zeros((10, m + p))
            own = slice(10 * link, 10 * link + 10)
            # congruence by the link's size: lengths in units of _LENGTH, masses in units of its own
            rows[:, own] = -_PSEUDO
            blocks.append(rows)
            floor = _LEAST / self.scale[10 * link]
            rights.append(-floor * np.array([1.0, 0, 1.0, 0, 0, 1.0, 0, 0, 0, 1.0]))
        return np.vstack(blocks), np.concatenate(rights)


def _pseudo_inertia() -> Array:
    """Return the matrix [10, 10] from standard parameters to the upper triangle of the pseudo-inertia, by columns,
    off-diagonal entries times sqrt 2.
    """
    root = np.sqrt(2.0)
    out = np.zeros((10, 10))
    m, mx, my, mz = 0, 1, 2, 3
    xx, xy, yy, xz, yz, zz = (_PLACES[name] for name in ("Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz"))
    for row, minus in ((0, xx), (2, yy), (5, zz)):
        out[row, [xx, yy, zz]] = 0.5
        out[row, minus] = -0.5
    for row, product in ((1, xy), (3, xz), (4, yz)):
        out[row, product] = -root
    for row, moment in ((6, mx), (7, my), (8, mz)):
        out[row, moment] = root
    out[9, m] = 1.0
    return out


_PSEUDO = _pseudo_inertia()

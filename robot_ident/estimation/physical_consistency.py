"""Parameters that a real arm can have: the nearest with every pseudo-inertia positive definite, their uncertainty, and
which inequality a set of parameters breaks that no arm can break.

Base parameters are possible when some standard inertias give them. The nearest ones, in the metric of the estimate's
own covariance, solve a semidefinite program (Clarabel), which yields standard inertias for all links with them. A link
with mass m, first moment h and inertia I about its frame is a body of non-negative density exactly when J = [[Sigma,
h], [h', m]], Sigma = tr(I) / 2 - I, is positive semidefinite (Wensing, Kim and Slotine, "Linear matrix inequalities for
physically consistent inertial parameter identification", 2018). Variables are scaled: masses in units of the link's
own, moments besides in powers of its length.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from robot_ident.errors import InputError
from robot_ident.estimation.driving import POSITIVE
from robot_ident.estimation.least_squares import information_root, root_of
from robot_ident.estimation.problem import Solution
from robot_ident.model.structure import Structure
from robot_ident.robot.rigid_body import STANDARD
from robot_ident.signals.motion import Array

LEAST = 1e-5  # kg, kg m^2: least eigenvalue of a link's pseudo-inertia, where the data would have it vanish
LENGTH = 0.3  # m: size of a link, which scales its moments
_COLUMN, _ROW = np.tril_indices(4)  # the upper triangle of J, by columns
IDENTITY = (_ROW == _COLUMN).astype(float)  # the upper triangle of the unit matrix [10]
# from standard parameters to the upper triangle of J, off-diagonal entries times sqrt 2
TRIANGLE = np.zeros((10, 10))
TRIANGLE[:6, 4:] = 0.5 * np.outer(IDENTITY[:6], IDENTITY[:6]) - np.diag(np.where(IDENTITY[:6], 1.0, np.sqrt(2.0)))
TRIANGLE[6:9, 1:4] = np.sqrt(2.0) * np.eye(3)
TRIANGLE[9, 0] = 1.0


def least_eigenvalues(standard: Array) -> Array:
    """Return the smallest eigenvalue of every link's pseudo-inertia [n], of standard parameters [10 n]."""
    triangles = np.asarray(standard).reshape(-1, 10) @ TRIANGLE.T / np.where(IDENTITY, 1.0, np.sqrt(2.0))
    out = np.empty((len(triangles), 4, 4))
    out[:, _ROW, _COLUMN] = out[:, _COLUMN, _ROW] = triangles
    return np.asarray(np.linalg.eigvalsh(out)[:, 0])


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
    def of(cls, structure: Structure, values: Array, covariance: Array) -> Nearest:
        """Return the program about linear parameters [p], some of which have no sense below zero."""
        robot, base = structure.robot, structure.base
        n, p, b = robot.n, len(values), len(base.columns)
        gather = np.zeros((p, 11 * n + p - b))
        gather[:b, : 11 * n] = base.regrouping
        gather[b:, 11 * n :] = np.eye(p - b)
        scale = np.concatenate([inertial_scale(structure, values[:b]), np.maximum(np.abs(values[b:]), 1.0)])
        start = np.concatenate([robot.rigid.parameters, robot.drives.armature, values[b:]])
        if not np.all(np.diag(covariance) > 0):
            unknown = structure.names[int(np.argmin(np.diag(covariance)))]
            raise InputError(
                f"the variance of {unknown} is zero; nothing can be near to parameters without uncertainty"
            )
        positive = np.array([*range(10 * n, 11 * n), *(11 * n + k - b for k in never_negative(structure))])
        return cls(gather, scale, start / scale, information_root(covariance, _SHARPEST), positive, n)

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
    triangles = np.kron(np.eye(len(slope) // 10), TRIANGLE)
    return -triangles @ slope, triangles @ offset - np.kron(least / scale[: len(slope) : 10], IDENTITY)


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
    upper = sparse.csc_matrix(sparse.triu(quadratic))
    answer = clarabel.DefaultSolver(upper, linear, sparse.csc_matrix(a), b, cones, settings).solve()
    if str(answer.status) not in ("Solved", "AlmostSolved"):
        raise InputError(
            f"no physically consistent parameters were found (the solver says {answer.status}): the estimate lies too"
            " far from any that links can have; look at what the model lacks first (robot_ident diagnose)"
        )
    return np.array(answer.x)


NEAR = 1e-3  # fall of chi-square, below which parameters count as possible
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
    program = Nearest.of(structure, values, np.diag((0.01 * scale) ** 2))
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
            moment[[10 * link + STANDARD.index(name) for name in (*others, minus)]] = 1.0, 1.0, -1.0
            weights, *_ = np.linalg.lstsq(base.regrouping.T, moment, rcond=None)
            weights[np.abs(weights) < 1e-9] = 0.0
            if np.abs(base.regrouping.T @ weights - moment).max() > 1e-9 or weights @ own >= 0:
                continue
            more, less = np.maximum(weights, 0.0), np.maximum(-weights, 0.0)
            out.append(
                f"{_sum(base.names, more)} >= {_sum(base.names, less)} does not hold: {more @ own:.4g} <"
                f" {less @ own:.4g} (second moment of link {link + 1} along {axis}, {others[0]} + {others[1]} -"
                f" {minus}, is negative)"
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


_DRAWS = 200  # of the noise, for the covariance; at least three a parameter


@dataclass(frozen=True)
class Consistent:
    """Physically consistent parameters.

    solution: with them in place of the estimate. inertias [10 n]: standard parameters of the links that give them,
    rotors [n] kg m^2. distance: sqrt of the rise of chi-square. violated: what the estimate broke. sharpened: by how
    much the largest change of a standard deviation, as a share of it, is that of `solution` below that of the data;
    None where the draws of the noise could not all be projected and the covariance is left as the data give it.
    """

    solution: Solution
    inertias: Array
    rotors: Array
    distance: float
    residual_rise: float
    violated: tuple[str, ...]
    sharpened: float | None

    @property
    def notes(self) -> tuple[str, ...]:
        """What happened, in a line or two."""
        said = [f"not physically possible as estimated: {one}" for one in self.violated]
        said.append(
            f"nearest possible parameters taken: {self.distance:.3g} standard deviations away (chi-square"
            f" +{self.distance**2:.3g}), mean squared residual {100 * self.residual_rise:+.2g} %"
            if self.violated
            else "the parameters are physically possible as estimated"
        )
        if self.sharpened is None:
            said.append("sigma is that of the data alone, an upper bound: what is possible could not be counted in")
        elif self.sharpened > 0.01:
            what = f"up to {100 * self.sharpened:.2g} % smaller than the data alone would give it"
            said.append(f"sigma counts in what is physically possible: {what}")
        return tuple(said)

    def to_dict(self) -> dict[str, Any]:
        """Return plain data for `model.yaml`."""
        robot = self.solution.structure.robot
        return {
            "distance": self.distance,
            "residual_rise": self.residual_rise,
            "violated": list(self.violated),
            "covariance": "data" if self.sharpened is None else "constrained",
            "inertias": {
                name: dict(zip(STANDARD, map(float, row), strict=True))
                for name, row in zip(robot.joints, self.inertias.reshape(robot.n, 10), strict=True)
            },
            "rotor_inertia": dict(zip(robot.joints, map(float, self.rotors), strict=True)),
        }


def nearest_physical(found: Solution) -> Consistent:
    """Return the physically consistent parameters nearest to an estimate, in the metric of its covariance.

    Their own covariance is that of the projected estimate. Raises InputError where the solver doesn't converge.
    """
    structure = found.structure
    p = len(structure.parameters)
    estimate, covariance = found.values[:p], found.covariance[:p, :p]
    program = Nearest.of(structure, estimate, covariance)
    x, values = program.to(estimate)
    step = values - estimate
    rise = program.squared_distance(step)
    n, equations = structure.robot.n, found.equations
    before, after = (equations.torque - equations.phi @ theta for theta in (estimate, values))
    violated = violations(structure, estimate)
    if rise > NEAR and not violated:
        violated = (separating(structure, estimate, program.normal(step)),)
    projected = projected_covariance(program, values, found.covariance)
    sharpened = None
    if projected is not None:
        std, other = np.sqrt(np.diag(found.covariance)), np.sqrt(np.diag(projected))
        sharpened = float(1.0 - np.min(other / np.where(std > 0, std, 1.0), where=std > 0, initial=1.0))
    return Consistent(
        solution=replace(
            found,
            values=np.concatenate([values, found.values[p:]]),
            covariance=found.covariance if projected is None else projected,
            chi_square=found.chi_square + rise,
        ),
        inertias=x[: 10 * n],
        rotors=rotors_of(structure, x, values),
        distance=float(np.sqrt(max(rise, 0.0))),
        residual_rise=float(np.sum(after**2) / np.sum(before**2) - 1.0),
        violated=violated,
        sharpened=sharpened,
    )


def rotors_of(structure: Structure, x: Array, values: Array) -> Array:
    """Return the rotor inertias [n] kg m^2 of standard parameters [11 n or more]; those that merge with no base
    parameter are effects, of linear parameters [p], or unknown and 0.
    """
    n = structure.robot.n
    rotors = x[10 * n : 11 * n] * structure.base.regrouping[:, 10 * n :].any(axis=0)
    for parameter, value in zip(structure.parameters, values, strict=True):
        if parameter.effect == "rotor_inertia" and parameter.joint is not None:
            rotors[structure.robot.joint_index(parameter.joint)] += value
    return np.asarray(rotors)


def projected_covariance(program: Nearest, values: Array, covariance: Array) -> Array | None:
    """Return E[e e'] [p + r, p + r] of parameters projected on what is possible, were `values` [p] the true ones.

    Noise of the data's covariance [p + r, p + r] is drawn (always the same, with exactly that covariance), added to
    the possible parameters and projected again: a parametric bootstrap. It equals the data's covariance where nothing
    impossible is near, and a projection onto a convex set moves nothing away from the truth in the metric of that
    covariance, so that it is smaller on the whole. None where a draw can't be projected.
    """
    p, size = len(values), len(covariance)
    draws = np.random.default_rng(1997).standard_normal((max(_DRAWS, 3 * size), size))
    draws = draws @ np.linalg.inv(np.linalg.cholesky(draws.T @ draws / len(draws))).T
    error = draws @ root_of(covariance).T
    try:
        error[:, :p] = [program.to(values + one[:p])[1] - values for one in error]
    except InputError:
        return None
    return np.asarray(error.T @ error / len(error))

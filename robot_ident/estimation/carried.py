"""Unknown payloads found together with the arm, where some recordings were made without them.

tau_k = Phi_k theta + Y_last,k pi_b of recording k that carried body b, tau_k = Phi_k theta of one without: the arm's
theta are shared, the ten parameters pi_b by all recordings of that body. Its torque is taken off where its least
squares value stands, so that every estimator of the arm has it; what its uncertainty makes of the arm's parameters is
added to their covariance.

What unknown payloads may add to the torque of their recordings, beside what is known of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy.linalg import block_diag

from robot_ident.errors import InputError
from robot_ident.estimation.equations import Equations, apart
from robot_ident.estimation.payload import VAGUE, Body, Holding, body_of, part_of, rows_of_payload, solve_beside
from robot_ident.estimation.problem import Problem, Solution, with_inner
from robot_ident.estimation.solve import solve
from robot_ident.model.structure import Structure
from robot_ident.recording.conditions import PayloadPart
from robot_ident.recording.measurement import Measurement
from robot_ident.recording.payload_torque import less_payload
from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Array

_ROUNDS = 8
_STILL = 0.02  # standard deviations that a payload's parameter may yet move by
_UNSETTLED = 0.5  # standard deviations: a search for inner parameters that stops by its own tolerance moves it by less


@dataclass(frozen=True)
class Carried:
    """A payload that was found with the arm: its name ("" where it has none), and the recordings that carried it."""

    name: str
    recordings: tuple[str, ...]
    body: Body

    @property
    def notes(self) -> tuple[str, ...]:
        """What a user should know."""
        head = f"payload {self.name}".rstrip()
        return (f"{head} of {', '.join(self.recordings)}: {self.body.in_words}", *(f"{head}: {n}" for n in self.said))

    @property
    def said(self) -> tuple[str, ...]:
        """What is doubtful about it."""
        nothing = ("it weighs no more than its uncertainty",) if self.body.mass < 3.0 * self.body.mass_std else ()
        return (*nothing, *self.body.notes)

    def to_dict(self) -> dict[str, Any]:
        """Return it for `model.yaml`."""
        return {
            "name": self.name,
            "recordings": list(self.recordings),
            **self.body.to_dict(),
            "covariance": self.body.covariance.tolist(),
            "notes": list(self.said),
        }


@dataclass(frozen=True)
class Solved:
    """The arm's solution and the measurements that it is of, payloads taken off; the payloads that were found, and how
    their m times ten parameters were free to change [10 m, k].
    """

    measurements: tuple[Measurement, ...]
    solution: Solution
    payloads: tuple[Carried, ...] = ()
    directions: Array = field(default_factory=lambda: np.zeros((0, 0)))

    def spread(self, covariance: Array) -> tuple[Carried, ...]:
        """Return the payloads with a covariance [10 m, 10 m] more of their parameters, from elsewhere than noise."""
        robot = self.solution.structure.robot
        out = []
        for k, one in enumerate(self.payloads):
            wider = one.body.covariance + covariance[own(k), own(k)]
            out.append(replace(one, body=body_of(one.body.values, wider, robot, one.body.given)))
        return tuple(out)


def solve_carrying(measurements: Sequence[Measurement], structure: Structure, estimator: str) -> Solved:
    """Return the arm's parameters, found together with the payloads that the measurements' conditions leave open.

    Raises InputError where every recording carried an unknown one: it can't be told from the last link then; where the
    motion tells no payload's mass; and where no drive tells Nm, for the data tell the product of mass and gain alone.
    """
    names = _names(measurements)
    if not names:
        return Solved(tuple(measurements), solve(apart(measurements, structure.effects), structure, estimator))
    refuse_untold(measurements)
    if not structure.robot.compares_with_newton_metres.all():
        refuse_without_scale(measurements, structure.robot)
    holdings = [Holding(_part(measurements, name), structure.robot) for name in names]
    values = np.array([holding.start() for holding in holdings])
    whole = _less(measurements, names, values, structure.robot)
    step = _step(apart(whole, structure.effects), structure, names, _freedom(holdings, values), None)
    for _ in range(_ROUNDS):
        _refuse_weightless(step.covariance, measurements, names)
        moved = values + step.change.reshape(values.shape)
        values = np.array([holding.settled(ten) for holding, ten in zip(holdings, moved, strict=True)])
        less = _less(whole, names, values, structure.robot)
        taken = apart(less, structure.effects)
        found = solve(taken, structure, estimator)
        step = _step(taken, structure, names, _freedom(holdings, values), found)
        if np.all(np.abs(step.change) <= _STILL * np.sqrt(np.diag(step.covariance))):
            break
    else:
        if np.any(np.abs(step.change) > _UNSETTLED * np.sqrt(np.diag(step.covariance))):
            raise InputError(
                f"{', '.join(m.source for m in measurements)}: payload and inner parameters of the effects don't settle"
                " together; identify the arm without these effects, or without the recordings of an unknown payload"
            )
    carried = []
    for k, name in enumerate(names):
        body = body_of(values[k], step.covariance[own(k), own(k)], structure.robot, holdings[k].given)
        carried.append(Carried(name, tuple(m.source for m in measurements if _body(m) == name), body))
    # what the payloads' uncertainty makes of the arm's: D C D', D = d theta / d pi
    covariance = np.array(found.covariance)
    covariance[np.ix_(step.place, step.place)] += step.slope @ step.covariance @ step.slope.T
    found = replace(found, covariance=covariance, dof=found.dof - step.told)
    return Solved(less, found, tuple(carried), _freedom(holdings, values)[0])


def own(number: int) -> slice:
    """Return where the ten parameters of a payload stand among those of all."""
    return slice(10 * number, 10 * number + 10)


def _names(measurements: Sequence[Measurement]) -> tuple[str, ...]:
    """Return the names of the unknown payloads."""
    return tuple(dict.fromkeys(m.conditions.body for m in measurements if m.conditions.estimated))


def _part(measurements: Sequence[Measurement], name: str) -> PayloadPart:
    """Return what the conditions of measurements tell of the unknown payload of a name."""
    return part_of((m.source, m.conditions) for m in measurements if _body(m) == name)


def _freedom(holdings: Sequence[Holding], values: Array) -> tuple[Array, Array]:
    """Return how the parameters of all payloads [10 m] may change [10 m, k], and what is known of each before data."""
    parts = [holding.directions(ten) for holding, ten in zip(holdings, values, strict=True)]
    return block_diag(*(directions for directions, _ in parts)), np.concatenate([vague for _, vague in parts])


def refuse_untold(measurements: Sequence[Measurement]) -> None:
    """Raise InputError where unknown payloads can't be told from the arm."""
    unknown = [m.source for m in measurements if m.conditions.estimated]
    if unknown and len(unknown) == len(measurements):
        raise InputError(
            f"{', '.join(unknown)}: an unknown payload is not told from the last link: give a recording without one"
            " beside it, or the arm's model: robot_ident identify BAG --only payload --model model.yaml"
        )


def refuse_without_scale(measurements: Sequence[Measurement], robot: Robot) -> None:
    """Raise InputError where unknown payloads come with drives none of which tells Nm: the scale of both is free."""
    unknown = [m for m in measurements if m.conditions.estimated]
    if unknown:
        raise InputError(
            f"{', '.join(m.source for m in unknown)}: payload and drive gains ({', '.join(robot.ampere_joints)}) are"
            " both unknown, and data tell their product alone: weigh it and state that (conditions: payload:"
            f" {{estimate: {unknown[0].conditions.body or 'box'}, mass: KG}}), and gains, centre and inertia are found;"
            " the recordings without it tell the gains over one another, and a model in A"
        )


@dataclass(frozen=True)
class _Step:
    """What the payloads' parameters [10 m] change by, their covariance [10 m, 10 m], and d theta / d pi [k, 10 m] of
    the arm's parameters at `place` [k] among all. told: how many of them data tell.
    """

    change: Array
    covariance: Array
    slope: Array
    place: np.ndarray
    told: float


def _step(
    measurements: Sequence[Measurement],
    structure: Structure,
    names: Sequence[str],
    freedom: tuple[Array, Array],
    found: Solution | None,
) -> _Step:
    """Return one step of Gauss and Newton for arm and payloads together, from the arm's solution if there is one."""
    problem = Problem(measurements, structure)
    p = len(structure.parameters)
    if found is None:
        equations = problem.equations(structure, None)
        jacobian, place, right = equations.phi, np.arange(p), equations.torque
    else:
        linear = found.values[:p]
        equations = problem.equations(found.structure, linear)
        problem = problem.beside(linear, equations) or problem
        jacobian, place = with_inner(problem, found.structure, linear, equations)
        right = equations.torque - equations.phi @ linear
    loads = rows_of_payloads(measurements, equations, structure.robot, names)
    arm, (directions, vague) = jacobian.shape[1], freedom
    whole = np.hstack([jacobian, loads @ directions])
    solved, spread = solve_beside(problem, equations, whole, right, ((), np.zeros((0, 0))), vague)
    spread = spread[arm:, arm:]
    labels = [(*structure.parameters, *structure.inner)[k].name for k in place]
    slope = -problem.factored(jacobian, labels).solve(problem.right(loads))
    told = len(vague) - float(np.sum(np.diag(spread) / vague**2))
    return _Step(directions @ solved[arm:], directions @ spread @ directions.T, slope, place, told)


def rows_of_payloads(
    measurements: Sequence[Measurement], equations: Equations, robot: Robot, names: Sequence[str]
) -> Array:
    """Return the columns [R, 10 m] of the unknown payloads of m names."""
    carriers = [[k for k, m in enumerate(measurements) if _body(m) == name] for name in names]
    return np.hstack([rows_of_payload(measurements, equations, robot, blocks) for blocks in carriers])


def _body(measured: Measurement) -> str | None:
    return measured.conditions.body if measured.conditions.estimated else None


def _less(
    measurements: Sequence[Measurement], names: Sequence[str], values: Array, robot: Robot
) -> tuple[Measurement, ...]:
    """Return the measurements less the torque of payloads of ten parameters each, values [m, 10]."""
    nothing = np.zeros((10, 10))
    pairs = zip(names, values, strict=True)
    known = {name: body_of(ten, nothing, robot).known for name, ten in pairs if ten.any()}
    return tuple(
        less_payload(m, known.get(m.conditions.body), robot) if m.conditions.estimated else m for m in measurements
    )


def _refuse_weightless(covariance: Array, measurements: Sequence[Measurement], names: Sequence[str]) -> None:
    """Raise InputError where the data don't tell a payload's mass, and with it no centre."""
    for k, name in enumerate(names):
        if np.sqrt(covariance[10 * k, 10 * k]) > 0.25 * VAGUE[0]:
            sources = ", ".join(m.source for m in measurements if _body(m) == name)
            raise InputError(
                f"{sources}: the motion does not tell the payload's mass; design one that does: robot_ident design"
                " --only payload -o payload.yaml"
            )


_DIGITS = 1e-9  # share of the largest singular value below which a motion shows nothing


def open_load(measurements: Sequence[Measurement], equations: Equations, robot: Robot) -> tuple[Array, Array]:
    """Return the torque [R] Nm of what is known of unknown payloads, and a basis [R, k] of what they may add to it.

    A known inertia counts where the centre is known too: about an unknown one it bends that space.
    """
    names = _names(measurements)
    if not names:
        return np.zeros(equations.rows), np.zeros((equations.rows, 0))
    loads = rows_of_payloads(measurements, equations, robot, names)
    torque, ways = np.zeros(equations.rows), []
    for k, name in enumerate(names):
        part = _part(measurements, name)
        holding = Holding(part if part.centre else replace(part, inertia=None), robot)
        values, columns = holding.start(), loads[:, own(k)]
        torque += columns @ values
        ways.append(basis_of(columns @ holding.directions(values)[0])[0])
    return torque, np.hstack(ways)


def basis_of(columns: Array) -> tuple[Array, Array]:
    """Return an orthonormal basis [R, r] of columns [R, k], and the combination of them [k, r] that it is: U = X T."""
    left, size, right = np.linalg.svd(columns, full_matrices=False)
    shown = size > _DIGITS * size[0]
    return np.asarray(left[:, shown]), np.asarray(right[shown].T / size[shown])

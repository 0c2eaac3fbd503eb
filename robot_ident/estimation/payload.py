"""Payloads: on an arm that is known, from a short motion, and together with the arm.

tau = Y theta + Y_last pi + friction: the arm's parameters theta keep what its model says, by their covariance; the ten
of the payload, in the last joint's frame, are free, and friction, which differs from day to day and with the load, is
found anew. What is known of the payload stays what it is while the rest is estimated.

Where some recordings of an unknown arm were made without them: tau_k = Phi_k theta + Y_last,k pi_b of recording k that
carried body b, tau_k = Phi_k theta of one without: the arm's theta are shared, the ten parameters pi_b by all
recordings of that body. Its torque is taken off where its least squares value stands, so that every estimator of the
arm has it; what its uncertainty makes of the arm's parameters is added to their covariance.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from robot_ident.errors import InputError
from robot_ident.estimation.equations import Equations, apart
from robot_ident.estimation.least_squares import information_root, sandwich
from robot_ident.estimation.problem import Problem, Solution, with_inner
from robot_ident.estimation.solve import solve
from robot_ident.model.model import Model
from robot_ident.model.structure import Structure
from robot_ident.recording.conditions import (
    Conditions,
    KnownPayload,
    PayloadPart,
    entries,
    hand,
    payload_columns,
    tensor,
)
from robot_ident.recording.measurement import Measurement, less_payload
from robot_ident.robot.rigid_body import STANDARD
from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Array

VAGUE = np.full(10, 200.0)  # kg, kg m, kg m^2: more than any payload, before data
NOTHING = 10.0  # kg, m, kg m^2: a larger standard deviation is no knowledge of what a hand carries
_SURE = 1.96  # standard deviations of a 95 % interval
_TOLD = 0.25  # share of what was known before that data must bring the standard deviation below
_CLEARLY = 4.0  # standard deviations


@dataclass(frozen=True)
class Body:
    """A payload: ten parameters [10] about and along the last joint's frame with covariance [10, 10], and what follows.

    centre [3] m in the end effector's frame; inertia (3 x 3) kg m^2 about the centre along its axes; their standard
    deviations by the first order. told [10]: whether the data say anything of a parameter. given: what was known before
    (mass, centre, inertia) and held.
    """

    values: Array
    covariance: Array
    told: tuple[bool, ...]
    centre: Array
    centre_std: Array
    inertia: Array
    inertia_std: Array
    given: tuple[str, ...] = ()

    @property
    def mass(self) -> float:
        """Mass [kg]."""
        return float(self.values[0])

    @property
    def mass_std(self) -> float:
        """Standard deviation of the mass [kg]."""
        return float(np.sqrt(self.covariance[0, 0]))

    @property
    def known(self) -> KnownPayload:
        """The same body as conditions state one."""
        return KnownPayload(self.mass, tuple(self.centre.tolist()), tuple(entries(self.inertia).tolist()))

    @property
    def in_words(self) -> str:
        """Mass and centre in one line."""
        place = (f"{c:.4f}" if s < NOTHING else "?" for c, s in zip(self.centre, self.centre_std, strict=True))
        mass = f"{self.mass:.4g} kg (given)" if "mass" in self.given else f"{self.mass:.4g} +- {self.mass_std:.2g} kg"
        return f"{mass} at [{', '.join(place)}] m{' (given)' if 'centre' in self.given else ''}"

    @property
    def notes(self) -> tuple[str, ...]:
        """What a user should know."""
        notes = []
        if self.mass <= 0:
            notes.append("its mass is not positive: does the model hold this payload already?")
        unknown = [name for name, known in zip(STANDARD, self.told, strict=True) if not known]
        if unknown:
            notes.append(f"the motion does not tell {', '.join(unknown)}")
        elif np.linalg.eigvalsh(self.inertia)[0] < -_CLEARLY * float(self.inertia_std.max()):
            notes.append("its inertia about the centre is that of no body: the arm's model may not be this arm's today")
        return tuple(notes)

    def to_dict(self) -> dict[str, Any]:
        """Return mass, centre, inertia and the ten parameters with their uncertainty."""
        std = np.sqrt(np.diag(self.covariance))
        return {
            "mass": self.mass,
            "mass_std": self.mass_std,
            "mass_interval": [self.mass - _SURE * self.mass_std, self.mass + _SURE * self.mass_std],
            "centre": self.centre.tolist(),
            "centre_std": self.centre_std.tolist(),
            "centre_interval": (self.centre[:, None] + _SURE * np.outer(self.centre_std, (-1.0, 1.0))).tolist(),
            "inertia": entries(self.inertia).tolist(),
            "inertia_std": entries(self.inertia_std).tolist(),
            "parameters": [
                {"name": name, "value": float(value), "std": float(s), "told": told}
                for name, value, s, told in zip(STANDARD, self.values, std, self.told, strict=True)
            ],
            "given": list(self.given),
        }


def body_of(values: Array, covariance: Array, robot: Robot, given: tuple[str, ...] = ()) -> Body:
    """Return the body of ten parameters [10] with covariance [10, 10] about and along the last joint's frame, of which
    something was `given`.

    With the mass m and first moment m p: centre R' (p - o), inertia R' (I - m (p^2 1 - p p')) R in the hand's frame of
    rotation R and origin o. Raises InputError where the hand isn't on the last link.
    """
    rotation, origin = hand(robot)

    def derived(x: Array) -> Array:
        mass, first = x[0], x[1:4]
        about = tensor(x[4:]) - _spread(first) / mass
        return np.concatenate([rotation.T @ (first / mass - origin), entries(rotation.T @ about @ rotation)])

    slope, found = _slope(derived, values, range(10)), derived(values)
    spread = np.sqrt(np.maximum(np.diag(slope @ covariance @ slope.T), 0.0))
    told = tuple((np.sqrt(np.diag(covariance)) < _TOLD * VAGUE).tolist())
    spread[:3] *= "centre" not in given
    spread[3:] *= "inertia" not in given
    return Body(values, covariance, told, found[:3], spread[:3], tensor(found[3:]), tensor(spread[3:]), given)


def _slope(function: Callable[[Array], Array], values: Array, places: Sequence[int] | np.ndarray) -> Array:
    """Return the derivatives of an analytic function by the values [10] at some places [k], by imaginary steps."""
    steps = 1e-30j * np.eye(10)[list(places)]
    return np.column_stack([function(values + step).imag for step in steps]) / 1e-30


def part_of(stated: Iterable[tuple[str, Conditions]]) -> PayloadPart:
    """Return what the conditions of recordings (source, conditions) say together of a payload that all of them carried.

    Raises InputError where they contradict each other.
    """
    told: dict[str, tuple[str, object]] = {}
    for source, conditions in stated:
        for name in conditions.part.given:
            value = getattr(conditions.part, name)
            first, known = told.setdefault(name, (source, value))
            if known != value:
                raise InputError(
                    f"{source}: payload {conditions.body}: {name} = {value}, where {first} states {known}; one name"
                    " stands for one body"
                )
    return PayloadPart(**{name: value for name, (_, value) in told.items()})  # type: ignore[arg-type]


class Holding:
    """The payloads that have a mass m, a centre c or an inertia J about it that are known, among those of any ten
    parameters (m, f = m c, I = J + S(f) / m) in the last joint's frame, S(f) = f^2 1 - f f'.

    Free are m, f and I where nothing is known of them; f = m c follows the mass where c is known, and I follows both
    where J is.
    """

    def __init__(self, part: PayloadPart, robot: Robot) -> None:
        """Hold `part`; InputError where the hand isn't on the last link."""
        rotation, self._origin = hand(robot)
        self.given = part.given
        self._mass = part.mass
        self._centre = None if part.centre is None else self._origin + rotation @ np.array(part.centre)
        self._inertia = None if part.inertia is None else rotation @ tensor(part.inertia) @ rotation.T

    def start(self) -> Array:
        """Return the ten parameters [10] to begin with: a known mass where the hand is, else nothing."""
        values = np.zeros(10)
        if self._mass is not None:
            values[0] = self._mass
            values[1:4] = self._mass * self._origin
        return self.settled(values)

    def settled(self, values: Array) -> Array:
        """Return the ten parameters [10] next to others that keep what is known."""
        out = np.array(values)
        if self._mass is not None:
            out[0] = self._mass
        if self._centre is not None:
            out[1:4] = out[0] * self._centre
        if self._inertia is not None and out[0] != 0.0:
            out[4:] = entries(self._inertia + _spread(out[1:4]) / out[0])
        return out

    def directions(self, values: Array) -> tuple[Array, Array]:
        """Return how the ten parameters may change about `values` [10, k], and how far before data [k]."""
        bound = self._inertia is not None and (self._centre is not None or values[0] != 0.0)
        fixed = [self._mass is not None, *[self._centre is not None] * 3, *[bound] * 6]
        free = np.flatnonzero(np.logical_not(fixed))
        return _slope(self.settled, values, free), VAGUE[free]


def _spread(first: Array) -> Array:
    """Return f^2 1 - f f' [3, 3]."""
    return np.asarray(first @ first * np.eye(3) - np.outer(first, first))


_ROUNDS = 8
_STILL = 0.02  # standard deviations that a parameter may yet move by
_LOUD = 1.4  # times the noise
_DIGITS = 1e-12  # share of the largest eigen- or singular value below which there is rounding alone


@dataclass(frozen=True)
class PayloadFit:
    """A payload, and how well a model of the arm with it follows the recordings.

    stated: what the recordings' conditions say of it, None where nothing. residual_rms by joint, noise_rms None where
    not known.
    """

    body: Body
    residual_rms: Mapping[str, float]
    noise_rms: Mapping[str, float | None]
    stated: KnownPayload | None
    notes: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """Return what `identify --only payload --json` prints."""
        return {
            "schema": "robot_ident/payload/1",
            **self.body.to_dict(),
            "residual_rms": dict(self.residual_rms),
            "noise_rms": dict(self.noise_rms),
            "stated_mass": None if self.stated is None else self.stated.mass,
            "notes": list(self.notes),
        }


def bare(conditions: Conditions) -> Conditions:
    """Return the conditions of a recording whose payload is to be found, whatever they state of it."""
    return replace(conditions, payload=None, estimated=False)


def identify_payload(
    measurements: Sequence[Measurement],
    model: Model,
    stated: KnownPayload | None = None,
    part: PayloadPart = PayloadPart(),  # noqa: B008 - frozen
) -> PayloadFit:
    """Return the payload that recordings of a known arm carried, `measurements` with it still in the torque.

    part: what is known of it and held.

    Raises InputError where the arm's parameters carry the unit A, or the hand is not on the last link.
    """
    robot, structure = model.robot, model.structure
    if robot.ampere_joints:
        raise InputError(f"robot {robot.name}: without drive gains ({', '.join(robot.ampere_joints)}) no mass is known")
    hand(robot)
    problem = Problem(measurements, structure)
    linear = model.linear
    equations = problem.equations(structure, linear)
    columns = rows_of_payload(measurements, equations, robot, range(len(measurements)))
    friction = {effect.name for effect in structure.effects if effect.symmetry in ("dissipative", "memory", "mixed")}
    held = [k for k, parameter in enumerate(structure.parameters) if parameter.effect not in friction]
    # directions without any spread are held firmly
    root = information_root(model.covariance[np.ix_(held, held)], _DIGITS)
    p, holding = len(linear), Holding(part, robot)
    values = holding.start()
    # a known inertia about an unknown centre bends the space of what is left
    for _ in range(_ROUNDS if part.inertia and not part.centre else 1):
        directions, vague = holding.directions(values)
        jacobian = np.hstack([equations.phi, columns @ directions])
        right = equations.torque - equations.phi @ linear - columns @ values
        before = np.zeros((len(held) + len(vague), p + len(vague)))
        before[: len(held), held], before[len(held) :, p:] = root, np.diag(1.0 / vague)
        solved, spread = solve_beside(problem, equations, jacobian, right, before)
        change, covariance = directions @ solved[p:], directions @ spread[p:, p:] @ directions.T
        values = holding.settled(values + change)
        if np.all(np.abs(change) <= _STILL * np.sqrt(np.diag(covariance))):
            break
    spread = problem.whatever_is_missing(equations, jacobian, right - jacobian @ solved, before.T @ before, spread)
    covariance = directions @ spread[p:, p:] @ directions.T
    found = body_of(values, covariance, robot, holding.given)
    if not all(found.told[:4]):
        raise InputError(
            f"{problem.source}: the motion does not tell mass and centre of a payload; design one:"
            " robot_ident design --only payload --model MODEL -o payload.yaml"
        )
    fits = equations.fits(right - jacobian @ solved, robot.joints)
    rms = {name: one.rms for name, one in fits.items()}
    noise = {
        name: None if one.noise_variance is None else float(np.sqrt(one.noise_variance)) for name, one in fits.items()
    }
    notes = list(found.notes)
    loud = [joint for joint, level in noise.items() if level is not None and rms[joint] > _LOUD * level]
    if loud:
        notes.append(
            f"the residual at {', '.join(loud)} is more than {_LOUD:g} times the noise: what the model lacks there (or"
            " a hand that swings) goes into the payload; its intervals count that, half a second left out at a time"
        )
    return PayloadFit(found, rms, noise, stated, tuple(notes))


def rows_of_payload(
    measurements: Sequence[Measurement], equations: Equations, robot: Robot, blocks: Iterable[int]
) -> Array:
    """Return the ten columns [R, 10] of a payload that some of the measurements carried, zero in rows of the others."""
    out = np.zeros((equations.rows, 10))
    for block in blocks:
        equations.put(out, block, measurements[block].passed(payload_columns(robot, measurements[block].motion)))
    return out


def solve_beside(
    problem: Problem, equations: Equations, jacobian: Array, right: Array, before: Array
) -> tuple[Array, Array]:
    """Return changes [p] by data and what is known before, and their covariance.

    jacobian [R, p]: derivatives of torque; right [R] Nm. before [k, p]: root of the information before data.
    """
    noise = problem.noise
    stacked = np.vstack([noise.weigh(jacobian), before])
    scale = np.linalg.norm(stacked, axis=0)
    scale = np.where(scale > 0, scale, 1.0)
    target = np.concatenate([noise.weigh(right), np.zeros(len(before))])
    q, triangle = np.linalg.qr(stacked / scale)
    left, size, turn = np.linalg.svd(triangle)
    kept = size > _DIGITS * size[0]
    inverse = turn[kept].T / size[kept]
    solved = inverse @ (left[:, kept].T @ (q.T @ target)) / scale
    bread = inverse @ inverse.T / np.outer(scale, scale)
    if not problem.unknown and noise.weighs:
        return solved, np.asarray(bread)
    residual = right - jacobian @ solved
    data = sandwich(bread, noise.precision(jacobian), residual, equations, noise, problem.unknown)
    return solved, np.asarray(data + bread @ before.T @ before @ bread)


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
    from scipy.linalg import block_diag

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
    before = np.hstack([np.zeros((len(vague), arm)), np.diag(1.0 / vague)])
    solved, spread = solve_beside(problem, equations, whole, right, before)
    counted = problem.whatever_is_missing(equations, whole, right - whole @ solved, before.T @ before, spread)
    spread, counted = spread[arm:, arm:], counted[arm:, arm:]
    labels = [(*structure.parameters, *structure.inner)[k].name for k in place]
    slope = -problem.factored(jacobian, labels).solve(problem.right(loads))
    told = len(vague) - float(np.sum(np.diag(spread) / vague**2))
    return _Step(directions @ solved[arm:], directions @ counted @ directions.T, slope, place, told)


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
        if np.sqrt(covariance[10 * k, 10 * k]) > _TOLD * VAGUE[0]:
            sources = ", ".join(m.source for m in measurements if _body(m) == name)
            raise InputError(
                f"{sources}: the motion does not tell the payload's mass; design one that does: robot_ident design"
                " --only payload -o payload.yaml"
            )


_SHOWN = 1e-9  # share of the largest singular value below which a motion shows nothing


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
    shown = size > _SHOWN * size[0]
    return np.asarray(left[:, shown]), np.asarray(right[shown].T / size[shown])

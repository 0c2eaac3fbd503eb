"""Unknown drive gains from recordings with and without a known payload, or their ratios where none was carried.

Reported currents u of drives of gain K: u_j = g_j (Y_j theta + Y_L,j pi_L) + e_j, g = 1/K, pi_L the payload that a
recording's conditions state. Its torque is known, so that it sets the scale of every drive that it loads (Gautier and
Briot, "Global identification of joint drive gains and dynamic parameters of robots", 2014). Without one the scale is
free: gains are found over that of one drive, and everything carries the unit A.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from robot_ident.errors import InputError
from robot_ident.estimation.declaration import judge_all
from robot_ident.estimation.equations import Equations
from robot_ident.estimation.least_squares import held_softly
from robot_ident.estimation.payload import (
    Solved,
    basis_of,
    open_load,
    refuse_untold,
    refuse_without_scale,
    rows_of_payloads,
)
from robot_ident.estimation.problem import Problem
from robot_ident.model.structure import Structure
from robot_ident.recording.measurement import Measurement, Processing
from robot_ident.recording.process import process
from robot_ident.recording.recording import Recording
from robot_ident.robot.robot import Definition, Robot
from robot_ident.robot.robot_file import definition_of, robot_of
from robot_ident.signals.motion import Array


@dataclass(frozen=True)
class Gains:
    """Gains of drives that a robot's files don't know.

    joints [k]; values [k]: Nm/A (N/A), or over the first one's where no payload was known (`absolute` False); logarithm
    [k, k]: covariance of ln K. payload [k]: rms torque Nm that the payload makes at each; unloaded: those that it
    hardly loads; unknown: whose gain stays unknown, so that their results carry the unit A. exchanged: the recordings
    whose payloads would tell the gains, were they stated the other way round.
    """

    joints: tuple[str, ...]
    units: tuple[str, ...]
    values: Array
    logarithm: Array
    payload: Array
    unloaded: tuple[str, ...]
    unknown: tuple[str, ...]
    absolute: bool
    exchanged: str = ""

    @property
    def std(self) -> Array:
        """Standard deviation of each gain [k]."""
        return np.asarray(self.values * np.sqrt(np.diag(self.logarithm)))

    def to_dict(self) -> list[dict[str, Any]]:
        """Return the gains for `model.yaml`."""
        rows = zip(self.joints, self.units, self.values, self.std, self.payload, strict=True)
        return [
            {
                "joint": joint,
                "value": float(value),
                "std": float(std),
                "unit": unit if self.absolute and joint not in self.unknown else "A/A",
                "payload_rms": float(load),
                "loaded": joint not in self.unloaded,
            }
            for joint, unit, value, std, load in rows
        ]

    @property
    def notes(self) -> tuple[str, ...]:
        """What a user should know."""
        known = [k for k, joint in enumerate(self.joints) if not self.absolute or joint not in self.unknown]
        found = ", ".join(f"{self.joints[k]} {self.values[k]:.4g} +- {self.std[k]:.2g}" for k in known)
        if not self.absolute:
            return (
                f"drive gains over that of {self.joints[0]}: {found}; results carry the unit A of that drive (predict:"
                " of each joint's own): a recording with a known payload beside one without would tell Nm/A (its"
                " BAG.conditions.yaml states the payload)",
            )
        if not known:
            way = f"; exchanged between {self.exchanged} they would" if self.exchanged else ""
            return (
                f"the payloads that the conditions state tell no drive gain: results carry the unit A{way}; is each"
                " stated beside its own recording, its mass in kg?",
            )
        notes = [f"drive gains by the payload, {self.units[0]}: {found}"]
        if self.unloaded:
            notes.append(f"the payload does not load {', '.join(self.unloaded)}: gains there come by the links alone")
        if self.unknown:
            values = ", ".join(f"{v:.3g}" for j, v in zip(self.joints, self.values, strict=True) if j in self.unknown)
            notes.append(
                f"the gain of {', '.join(self.unknown)} stays unknown: results there carry the unit A, of a drive of"
                f" 1 {self.units[0]}, with {values} for it; give its torque_constant where a data sheet knows it"
            )
        return tuple(notes)


def robot_with(robot: Robot, gains: Gains) -> Robot:
    """Return a robot whose files would know these gains: torque constants, or relative gains where the unit stays A."""

    def changed(name: str, entry: dict[str, Any]) -> dict[str, Any]:
        value = float(gains.values[gains.joints.index(name)]) * (robot.effort.of(name).relative or 1.0)
        if name not in gains.unknown:
            return {**entry, "torque_constant": value}
        told = entry.get("effort", {})
        return {**entry, "effort": {**({"quantity": told} if isinstance(told, str) else told), "relative_gain": value}}

    return _changed(robot, gains.joints, changed)


def robot_without(robot: Robot, joints: Sequence[str]) -> Robot:
    """Return a robot whose files don't know the torque constants of some joints."""
    return _changed(robot, joints, lambda _, entry: {k: v for k, v in entry.items() if k != "torque_constant"})


def _changed(robot: Robot, some: Sequence[str], change: Callable[[str, dict[str, Any]], dict[str, Any]]) -> Robot:
    """Return a robot whose YAML has other entries for some of its joints."""
    definition = definition_of(robot)
    entries: Mapping[str, Any] = definition.yaml.get("joints") or {}
    joints = {name: dict(entries.get(name) or {}) for name in robot.joints}
    joints |= {name: change(name, joints[name]) for name in some}
    return robot_of(Definition({**definition.yaml, "joints": joints}, definition.urdf), robot.source)


_VAGUE = 1.0  # standard deviation of ln K before data, about what the URDF's masses or the other drives make of it
_SURE = 3.0  # sigma of a share of the URDF's torque that tells a gain to begin with
_UNKNOWN = 0.2  # standard deviation of ln K after data from which on a gain is not known
_LOADED = 0.01  # share of a joint's torque that a payload must make
_ROUNDS = 30
_STILL = 1e-7  # of ln K, between rounds


@dataclass(frozen=True)
class _Currents:
    """The stacked equations in reported units with the payload's torque [R] Nm, and which joints' gains are free.

    names: of the columns, the arm's and after them what unknown payloads may add.
    """

    problem: Problem
    equations: Equations
    load: Array
    free: tuple[int, ...]
    names: list[str]

    def model(self, theta: Array, g: Array) -> tuple[Array, Array]:
        """Return the current [R] and its derivatives by theta and ln g of the free joints [R, p + k]."""
        factor = g[self.equations.joint]
        current = factor * (self.equations.phi @ theta + self.load)
        own = current[:, None] * (self.equations.joint[:, None] == np.array(self.free))
        return current, np.hstack([factor[:, None] * self.equations.phi, own])


def _directions(count: int) -> list[str]:
    return [f"payload, direction {k + 1}" for k in range(count)]


def estimate_gains(measurements: Sequence[Measurement], structure: Structure) -> Gains:
    """Return the gains of the drives that report a current of unknown Nm/A, from measurements in what they report.

    A payload of which the mass alone is known tells them as well; what else it may be is found with them. Raises
    InputError where payloads are stated that make no difference: recordings with and without one are needed; and where
    nothing tells the scale of gains and of an unknown payload.
    """
    robot = structure.robot
    free = tuple(j for j in range(robot.n) if robot.in_ampere(j))
    if robot.effort.coupling is not None:
        raise InputError(f"{robot.source}: drive gains behind effort.coupling can't be estimated: give torque_constant")
    structure, _ = structure.with_only(lambda effect: not (effect.uses_torque or effect.inner))
    problem = Problem(measurements, structure)
    equations = problem.equations(structure, None)
    load = _payload(measurements, equations, robot)
    equations = replace(equations, torque=equations.torque + robot.compares_with_newton_metres[equations.joint] * load)
    stated = [(m.conditions.payload, m.conditions.body) for m in measurements]
    weighed = any(m.conditions.payload or m.conditions.part.mass for m in measurements)
    absolute = weighed or len(free) < robot.n
    if not absolute:
        refuse_without_scale(measurements, robot)
    if weighed and len(set(stated)) < 2:
        raise InputError(
            f"{problem.source}: all were recorded with the same payload; drive gains need one without it, or another"
        )
    held, further = open_load(measurements, equations, robot)
    equations = replace(equations, phi=np.hstack([equations.phi, further]))
    currents = _Currents(problem, equations, load + held, free, [*problem.names, *_directions(further.shape[1])])
    start = _start([m for m in measurements if not m.conditions.estimated], robot)
    if not absolute:
        start = start / start[free[0]]
    scale = () if absolute else (free[0],)  # the drive that sets it
    g, theta, logarithm = _search(currents, 1.0 / start, scale)
    vague = tuple(np.array(free)[np.diag(logarithm) > _UNKNOWN**2].tolist())
    if vague:
        g = _like_the_others(g, vague, free, robot)
        g, theta, logarithm = _search(currents, g, (*scale, *vague))
        logarithm += np.diag([_VAGUE**2 if joint in vague else 0.0 for joint in free])
    carried = currents.load + further @ theta[len(problem.names) :]
    gains = _gains(currents, robot, 1.0 / g, logarithm, carried, absolute=absolute)
    if not absolute or set(gains.unknown) != set(gains.joints):
        return gains
    return replace(gains, exchanged=_exchanged(currents, measurements, robot, 1.0 / start))


def _exchanged(currents: _Currents, measurements: Sequence[Measurement], robot: Robot, g: Array) -> str:
    """Return two recordings whose known payloads tell all gains where they are exchanged, or nothing."""
    plain = not robot.compares_with_newton_metres.any() and not any(m.conditions.estimated for m in measurements)
    if len(measurements) != 2 or not plain:
        return ""
    one, two = measurements
    other = [replace(one, conditions=two.conditions), replace(two, conditions=one.conditions)]
    load = _payload(other, currents.equations, robot)
    _, _, logarithm = _search(replace(currents, load=load), g, ())
    told = float(np.diag(logarithm).max()) <= _UNKNOWN**2
    return f"{one.source} and {two.source}" if told else ""


def _payload(measurements: Sequence[Measurement], equations: Equations, robot: Robot) -> Array:
    """Return the torque [R] Nm of the stated payloads at the rows of the equations."""
    out = np.zeros(equations.rows)
    for block, measured in enumerate(measurements):
        stated = measured.conditions.payload
        if stated is not None:
            equations.put(out, block, measured.passed(stated.torque(robot, measured.motion)))
    return out


def _start(measurements: Sequence[Measurement], robot: Robot) -> Array:
    """Return gains [n] to begin with: what the URDF's masses make of them, friction set apart; 1 where they are known.

    Where that tells nothing, as of a last joint whose torque is all friction, the drive counts as like the others.
    """
    g, judged = np.ones(robot.n), judge_all(measurements, robot)
    free = [joint for joint in range(robot.n) if robot.in_ampere(joint)]
    unidentifiable = [joint for joint in free if not judged[joint].share > _SURE * judged[joint].std]
    told = [joint for joint in free if joint not in unidentifiable]
    g[told] = [judged[joint].share for joint in told]
    return 1.0 / _like_the_others(g, unidentifiable, free, robot)


def _like_the_others(g: Array, unidentifiable: Sequence[int], free: Sequence[int], robot: Robot) -> Array:
    """Return g [n] where drives that nothing tells of have the geometric mean of the others of their kind, or 1.

    What is taken for them matters little: they are those whose torque beside friction hardly exceeds its noise.
    """
    out = np.array(g)
    for joint in unidentifiable:
        others = [k for k in free if k not in unidentifiable and robot.prismatic[k] == robot.prismatic[joint]]
        out[joint] = float(np.exp(np.mean(np.log(g[others])))) if others else 1.0
    return out


def _search(currents: _Currents, g: Array, held: tuple[int, ...]) -> tuple[Array, Array, Array]:
    """Return g [n], theta [p] and the covariance of ln K [k, k] by Gauss-Newton on theta and ln g, some held."""
    equations, problem = currents.equations, currents.problem
    free, p = currents.free, currents.equations.phi.shape[1]
    searched = [k for k, joint in enumerate(free) if joint not in held]
    places = [free[k] for k in searched]
    columns = [*range(p), *(p + k for k in searched)]
    names = [*currents.names, *(f"gain of joint {joint + 1}" for joint in places)]
    problem, before = _with_noise(problem, currents, g), np.log(g[places])
    for _ in range(_ROUNDS):
        factor = g[equations.joint]
        solver = problem.factored(factor[:, None] * equations.phi, currents.names)
        theta = solver.solve(problem.right(equations.torque - factor * currents.load))
        current, jacobian = currents.model(theta, g)
        white, right = (problem.noise.weigh(x) for x in (jacobian[:, columns], equations.torque - current))
        step = held_softly(white, right, before - np.log(g[places]), _VAGUE)[p:]
        g = g.copy()
        g[places] *= np.exp(np.clip(step, -0.7, 0.7))
        problem = _with_noise(problem, currents, g)
        if not searched or np.abs(step).max() < _STILL:
            break
    current, jacobian = currents.model(theta, g)
    covariance = np.zeros((len(free), len(free)))
    if searched:
        own = problem.covariance(equations, jacobian[:, columns], equations.torque - current, names)[p:, p:]
        soft = np.eye(len(own)) / _VAGUE**2  # what was known before
        covariance[np.ix_(searched, searched)] = np.linalg.inv(np.linalg.inv(own) + soft)
    return g, theta, covariance


def _with_noise(problem: Problem, currents: _Currents, g: Array) -> Problem:
    """Return the problem with rows weighted by what these gains leave, where no periods tell the noise."""
    if not problem.unknown:
        return problem
    equations = currents.equations
    factor = g[equations.joint]
    phi, torque = factor[:, None] * equations.phi, equations.torque - factor * currents.load
    residual = torque - phi @ np.linalg.lstsq(phi, torque, rcond=None)[0]
    variance = equations.variance.copy()
    for block in problem.unknown:
        for rows in equations.of_joints(block):
            variance[rows] = max(float(np.mean(residual[rows] ** 2)), 1e-24)
    return problem.weighted_by(equations, variance, problem.notes)


def _gains(
    currents: _Currents, robot: Robot, constant: Array, logarithm: Array, load: Array, *, absolute: bool
) -> Gains:
    """Return the gains with what is loaded by payloads of torque `load` [R] Nm, and what stays unknown."""
    free, equations = currents.free, currents.equations
    payload, unloaded = [], []
    for joint in free:
        rows = equations.joint == joint
        size = float(np.sqrt(np.mean(load[rows] ** 2)))
        whole = float(np.sqrt(np.mean((constant[joint] * equations.torque[rows]) ** 2)))
        known = equations.variance[rows][np.isfinite(equations.variance[rows])]
        noise = constant[joint] * float(np.sqrt(np.mean(known))) if len(known) else 0.0
        payload.append(size)
        if size < _LOADED * whole or size < noise:
            unloaded.append(robot.joints[joint])
    names = tuple(robot.joints[joint] for joint in free)
    units = tuple("N/A" if robot.prismatic[joint] else "Nm/A" for joint in free)
    spread = zip(names, np.diag(logarithm), strict=True)
    unknown = tuple(name for name, s in spread if s > _UNKNOWN**2 or not absolute)
    values = constant[list(free)]
    return Gains(names, units, values, logarithm, np.array(payload), tuple(unloaded), unknown, absolute)


def with_known_gains(
    recordings: Sequence[Recording],
    measurements: Sequence[Measurement],
    structure: Structure,
    processing: Processing | None,
) -> tuple[Sequence[Measurement], Structure, Gains | None]:
    """Return measurements and structure of the robot whose gains the recordings tell; as given where all are known."""
    robot = structure.robot
    if not robot.ampere_joints:
        return measurements, structure, None
    refuse_untold(measurements)
    gains = estimate_gains(measurements, structure)
    known = robot_with(robot, gains)
    again = [process(recording, known, processing) for recording in recordings]
    return again, Structure.build(known, [effect.label for effect in structure.added]), gains


def spread_by_gains(gains: Gains, solved: Solved, structure: Structure, values: Array) -> Array:
    """Return the covariance [p + 10 m] that linear parameters and those of the payloads found with them have by that of
    the gains: D C D', D = d (theta, pi) / d ln K.
    """
    measurements, directions = solved.measurements, solved.directions
    problem = Problem(measurements, structure)
    equations = problem.equations(structure, values)
    load = _payload(measurements, equations, structure.robot)
    torque = equations.torque + structure.robot.compares_with_newton_metres[equations.joint] * load
    columns = [np.where(equations.joint == structure.robot.joint_index(joint), torque, 0.0) for joint in gains.joints]
    changed, p = problem.right(np.column_stack(columns)), len(structure.parameters)
    if not solved.payloads:
        slopes = problem.factored(equations.phi, structure.names).solve(changed)
    else:
        loads = rows_of_payloads(measurements, equations, structure.robot, [one.name for one in solved.payloads])
        ways, turn = basis_of(loads @ directions)
        names = [*structure.names, *_directions(ways.shape[1])]
        found = problem.factored(np.hstack([equations.phi, ways]), names).solve(changed)
        slopes = np.vstack([found[:p], directions @ (turn @ found[p:])])
    return np.asarray(slopes @ gains.logarithm @ slopes.T)

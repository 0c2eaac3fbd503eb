"""Maximum likelihood: parameters and trajectory together (Swevers et al. 1997, eqs. 3 to 6).

The trajectory of each joint is q(t) = q0 + sum_l over the Fourier lines of its measured position that hold more than
noise (eq. 11, with as many lines as the robot shows; of faint ones their share, whose error is as much smaller).
K = 1/2 sum (q_m - q(delta))^2 / s_q^2 + 1/2 (tau_m - tau)' S^-1 (tau_m - tau), tau = Phi(q(delta), dq(delta),
ddq(delta)) theta, is minimised by Levenberg-Marquardt on exact derivatives. The lines being orthogonal over a period,
the first sum is delta' P^-1 delta about the measured lines, and the normal equations have the form of an arrow: theta
couples to every measurement's delta, these not to each other, so that each delta is eliminated by its Schur
complement. What is left, F_tt - F_td F_dd^-1 F_dt, is the Fisher information of theta (eq. 6 printed right: Fi = sum J'
W J), its inverse the Cramer-Rao bound.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from robot_ident.errors import InputError
from robot_ident.estimation.equations import Equations
from robot_ident.estimation.problem import Problem, Solution, beside_wls, inner_bounds, solution, with_inner
from robot_ident.model.derivatives import torque_derivatives
from robot_ident.model.structure import Structure
from robot_ident.recording.measurement import Measurement
from robot_ident.signals.motion import Array, Mask

_ITERATIONS = 30
_TOLERANCE = 1e-6  # of the predicted fall of chi-square: no parameter then moves by more than a thousandth of its sigma
_TOLD = 1e-4  # of what the positions say of a line, below which the torque does not count
_TELL = 0.3  # sigmas of difference from wls that are worth a word


@dataclass(frozen=True)
class Trajectory:
    """The lines of one measured period: bases B, dB, ddB [N, d] of all joints' coefficients delta [d].

    joint [d]: whose position a coefficient enters. variance [d]: of its error, 2 s^2 / N of an amplitude, times the
    share of a faint line that counts as motion.
    """

    basis: tuple[Array, ...]
    joint: np.ndarray
    variance: Array

    @classmethod
    def of(cls, measured: Measurement, structure: Structure, values: Array) -> Trajectory:
        """Return the lines of a measurement's motion that its torque could move; InputError where it isn't periodic."""
        share, noise = measured.line_share, measured.averaged_position_variance
        if share is None or noise is None or measured.base_frequency is None:
            raise InputError(
                f"{measured.source}: ml estimates the lines of a periodic motion; this recording is not periodic:"
                " use --estimator wls or iv"
            )
        samples = measured.motion.samples
        lines = (share > 0.0) & _movable(measured, noise, structure, values)
        t = np.arange(samples)[:, None] * measured.dt
        parts, joint, variance = [], [], []
        for index in range(lines.shape[1]):
            k = np.flatnonzero(lines[1:, index]) + 1
            w = 2.0 * np.pi * measured.base_frequency * k
            c, s = np.cos(w * t), np.sin(w * t)
            one, zero = np.ones((samples, 1)), np.zeros((samples, 1))
            orders = (one, c, s), (zero, -w * s, w * c), (zero, -w * w * c, -w * w * s)
            parts.append([np.hstack(order) for order in orders])
            joint.append(np.full(2 * len(k) + 1, index))
            size = max(float(noise[index]), 1e-24) / samples
            variance.append(np.concatenate([[size], np.tile(2.0 * size * share[k, index], 2)]))
        basis = (np.hstack(order) for order in zip(*parts, strict=True))
        return cls(tuple(basis), np.concatenate(joint), np.concatenate(variance))


@dataclass(frozen=True)
class State:
    """A point of the search: inner parameters in the structure, theta [p], delta of each measurement, the residual [R]
    Nm, and the cost.
    """

    structure: Structure
    values: Array
    delta: tuple[Array, ...]
    problem: Problem
    equations: Equations
    residual: Array
    cost: float


@dataclass(frozen=True)
class Normal:
    """The arrow: F_tt [a, a], gradient [a]; blocks: of each measurement F_td [a, d], F_dd [d, d] with prior, gradient
    [d].
    """

    own: Array
    slope: Array
    blocks: tuple[tuple[Array, Array, Array], ...]

    def information(self, damping: float = 0.0) -> tuple[Array, Array, list[Any]]:
        """Return F_tt - F_td F_dd^-1 F_dt [a, a], its gradient [a], factors of F_dd; diagonals times 1 + damping."""
        from scipy.linalg import cho_factor, cho_solve

        own, slope, factors = self.own + damping * np.diag(np.diag(self.own)), self.slope, []
        for cross, inner, right in self.blocks:
            factors.append(cho_factor(inner + damping * np.diag(np.diag(inner)), lower=True))
            own = own - cross @ cho_solve(factors[-1], cross.T)
            slope = slope - cross @ cho_solve(factors[-1], right)
        return own, slope, factors

    def step(self, damping: float) -> tuple[Array, list[Array], float]:
        """Return the changes of theta and free inner parameters [a], of each delta, and the predicted fall of cost."""
        from scipy.linalg import cho_solve

        own, slope, factors = self.information(damping)
        scale = np.sqrt(np.diag(own))
        theta = np.linalg.solve(own / np.outer(scale, scale), slope / scale) / scale
        pairs = list(zip(factors, self.blocks, strict=True))
        delta = [cho_solve(factored, right - cross.T @ theta) for factored, (cross, _, right) in pairs]
        gain = theta @ self.slope + sum(d @ right for d, (_, (*_, right)) in zip(delta, pairs, strict=True))
        return theta, delta, float(gain)


def _movable(measured: Measurement, noise: Array, structure: Structure, values: Array) -> Mask:
    """Return the lines [K + 1, n] of which the torque says more than a ten-thousandth of what the positions say.

    The others stay as measured; a noise-free simulation has hundreds of them. var sum_i mean(g_i^2) N / s_i^2, g the
    slope of the torque of joint i: d tau / d q, times w and w^2 for velocity and acceleration.
    """
    slopes = torque_derivatives(structure, measured.motion, values)
    samples = measured.motion.samples
    frequency = np.arange(samples // 2 + 1) * (measured.base_frequency or 0.0)
    weight = 1.0 / measured.averaged_variance[:, None]
    out = np.zeros((len(frequency), measured.motion.joints), dtype=bool)
    parts = (slopes.position, slopes.velocity, slopes.acceleration)
    size = [np.sum(weight * np.mean(part**2, axis=0), axis=0) for part in parts]
    for joint, variance in enumerate(noise):
        told = sum(power[joint] * (2.0 * np.pi * frequency) ** (2 * order) for order, power in enumerate(size))
        out[:, joint] = max(float(variance), 1e-24) * told > _TOLD
    out[0] = True
    out[2 * np.arange(len(out)) >= samples] = False
    return out


def maximum_likelihood(problem: Problem, start: Solution) -> Solution:
    """Return the maximum-likelihood estimate with its Cramer-Rao bound, searched from a weighted least-squares one.

    Raises InputError where a measurement isn't periodic.
    """
    p = len(start.structure.parameters)
    trajectories, state = _start(problem, start.structure, start.values[:p])
    normal, neglected = _normal(trajectories, state)
    damping = 0.0
    for _ in range(_ITERATIONS):
        theta, delta, predicted = normal.step(damping)
        trial = _moved(problem, trajectories, state, theta, delta)
        if trial.cost <= state.cost * (1.0 + 1e-12):
            state, damping = trial, 0.1 * damping if damping > 1e-8 else 0.0
            normal, _ = _normal(trajectories, state)
            if predicted < _TOLERANCE:
                break
        else:
            damping = max(10.0 * damping, 1e-4)
            if damping > 1e8:
                break
    return _finished(state, start, normal, neglected)


def _start(problem: Problem, structure: Structure, values: Array) -> tuple[list[Trajectory], State]:
    """Return the lines of the measured motions, and the point at which they are as measured."""
    trajectories = [Trajectory.of(measured, structure, values) for measured in problem.measurements]
    still = [np.zeros(len(trajectory.joint)) for trajectory in trajectories]
    return trajectories, _at(problem, trajectories, structure, values, still)


def _at(
    problem: Problem, trajectories: Sequence[Trajectory], structure: Structure, values: Array, delta: Sequence[Array]
) -> State:
    measurements = []
    for measured, lines, d in zip(problem.measurements, trajectories, delta, strict=True):
        motion, own = measured.motion, d[:, None] * (lines.joint[:, None] == np.arange(measured.motion.joints))
        q, dq, ddq = (base @ own for base in lines.basis)
        moved = replace(motion, q=motion.q + q, dq=motion.dq + dq, ddq=motion.ddq + ddq)
        measurements.append(replace(measured, motion=moved))
    here = problem.moved(measurements, structure)
    equations = here.equations(structure, values)
    residual = equations.torque - equations.phi @ values
    prior = sum(float(np.sum(d * d / t.variance)) for d, t in zip(delta, trajectories, strict=True))
    cost = float(np.sum(problem.noise.weigh(residual) ** 2)) + prior
    return State(structure, values, tuple(delta), here, equations, residual, cost)


def _moved(
    problem: Problem, trajectories: Sequence[Trajectory], state: State, step: Array, further: Sequence[Array]
) -> State:
    p, structure = len(state.values), state.structure
    if len(step) > p:
        settings, (lower, upper, free) = structure.settings.copy(), inner_bounds(structure)
        settings[free] = np.clip(settings[free] + step[p:], lower[free], upper[free])
        structure = structure.with_settings(settings)
    delta = [old + new for old, new in zip(state.delta, further, strict=True)]
    return _at(problem, trajectories, structure, state.values + step[:p], delta)


def _normal(trajectories: Sequence[Trajectory], state: State) -> tuple[Normal, tuple[str, ...]]:
    """Return the normal equations at a point and the effects whose dependence on the trajectory is neglected."""
    noise, equations = state.problem.noise, state.equations
    jacobian, _ = with_inner(state.problem, state.structure, state.values, equations)
    theta_rows, residual = noise.weigh(jacobian), noise.weigh(state.residual)
    blocks = []
    neglected: tuple[str, ...] = ()
    points = zip(state.problem.measurements, trajectories, state.delta, strict=True)
    for block, (measured, trajectory, delta) in enumerate(points):
        slopes = torque_derivatives(state.structure, measured.motion, state.values)
        parts = zip((slopes.position, slopes.velocity, slopes.acceleration), trajectory.basis, strict=True)
        by_delta = sum(slope[:, :, trajectory.joint] * base[:, None, :] for slope, base in parts)
        whole = np.zeros((equations.rows, len(delta)))
        rows = equations.put(whole, block, measured.passed(np.asarray(by_delta)))
        whole, prior, neglected = noise.weigh(whole)[rows], 1.0 / trajectory.variance, slopes.neglected
        inner, right = whole.T @ whole + np.diag(prior), whole.T @ residual[rows] - delta * prior
        blocks.append((theta_rows[rows].T @ whole, inner, right))
    return Normal(theta_rows.T @ theta_rows, theta_rows.T @ residual, tuple(blocks)), neglected


def _finished(state: State, start: Solution, normal: Normal, neglected: tuple[str, ...]) -> Solution:
    """Return the solution at the optimum with the Cramer-Rao bound and what ml changed."""
    found = solution(state.problem, state.structure, state.values, state.equations)
    information, *_ = normal.information()
    root = np.sqrt(np.diag(information))
    scale = np.outer(root, root)
    _, place = with_inner(state.problem, state.structure, state.values, state.equations)
    covariance = np.zeros_like(found.covariance)
    # coloured noise that is not weighed by its inverse: what it adds to the bound is added here
    bound, plain = (np.linalg.inv(part / scale) / scale for part in (information, normal.own))
    colour = found.covariance[np.ix_(place, place)] - plain if not state.problem.noise.weighs else 0.0
    covariance[np.ix_(place, place)] = bound + colour
    words = ": position noise matters here", ": position noise does not matter here"
    notes = [*found.notes, beside_wls("ml", found.values, start, covariance, _TELL, words)]
    if neglected:
        notes.append(f"ml holds the columns of {', '.join(neglected)} at the estimated trajectory, without their slope")
    excess = found.excess
    if not np.isnan(found.dof):  # what the noise of positions makes of the residual is none
        ratio = state.problem.beyond_chance(np.array([state.cost / found.dof]), np.array([found.dof]))
        excess = np.where(found.excess > 1.0, ratio, 1.0)
    return replace(found, covariance=covariance, chi_square=state.cost, notes=tuple(notes), excess=excess)


def information(
    measurements: Sequence[Measurement], structure: Structure, values: Array | None = None, *, bound: bool = False
) -> Array:
    """Return F' S^-1 F [p, p] of measurements, S the noise that they show (eq. 9): what a further motion adds to.

    values [p]: where columns depend on the model's torque. bound: with noise on positions too, the Schur complement
    F_tt - F_td F_dd^-1 F_dt (eq. 6), which needs values. Inner parameters count as known. Raises InputError where the
    bound is asked for and a measurement isn't periodic.
    """
    problem = Problem(measurements, structure)
    equations = problem.equations(structure, values)
    if not bound:
        rows = problem.noise.weigh(equations.phi)
        return np.asarray(rows.T @ rows)
    if values is None:
        raise ValueError("the bound needs an estimate")
    for measured in measurements:
        if measured.position_lines is None:
            raise InputError(
                f"{measured.source}: not periodic, so its position noise is unknown and the Cramer-Rao bound too;"
                " use another criterion"
            )
    normal, _ = _normal(*_start(problem, structure, values))
    p = len(structure.parameters)
    return normal.information()[0][:p, :p]


_ACCELERATION = 1e-3  # of its rms: noise of the acceleration below which nothing needs to be computed
_TORQUE = 0.1  # of the torque's noise variance: more is worth a word


def _torque_of_position_noise(measured: Measurement, structure: Structure, values: Array) -> Array:
    """Return the variance [n] (Nm)^2 that the noise of the motion's lines gives the model's torque, mean over time; 0
    where the acceleration has next to none, or nothing repeats.

    Lines of equal noise sigma^2 / N (twice that but for the mean), cosine and sine alike, give the position a variance
    v_0 at every instant, the velocity v_1, the acceleration v_2, and position and acceleration the covariance -v_1:
    var tau = sum over joints of (dtau/dq)^2 v_0 + ((dtau/ddq)^2 - 2 dtau/dq dtau/dddq) v_1 + (dtau/dddq)^2 v_2.
    Lines count by the share of them that the motion holds, which is what is left of their variance, and by what the low
    pass of the measurement leaves of them.
    """
    lines, noise = measured.line_share, measured.averaged_position_variance
    if lines is None or noise is None or measured.base_frequency is None:
        return np.zeros(len(measured.joints))
    rates = 2.0 * np.pi * measured.base_frequency * np.arange(len(lines))
    size = noise / measured.motion.samples
    shaken, moved = np.sqrt(2.0 * size * (lines.T @ rates**4)), np.sqrt(np.mean(measured.motion.ddq**2, axis=0))
    if np.all(shaken < _ACCELERATION * np.maximum(moved, 1e-12)):
        return np.zeros(len(measured.joints))
    gain = getattr(measured.low_pass, "gain", None)
    weight = lines if gain is None else lines * np.asarray(gain, dtype=float)[: len(lines), None] ** 2
    v0 = size * (2.0 * weight.sum(axis=0) - weight[0])
    v1, v2 = (2.0 * size * (weight.T @ rates**power) for power in (2, 4))
    slopes = torque_derivatives(structure, measured.motion, values)
    q, v, a = slopes.position, slopes.velocity, slopes.acceleration
    return np.asarray(np.mean(q**2 @ v0 + (v**2 - 2.0 * q * a) @ v1 + a**2 @ v2, axis=0))


def position_notes(measurements: Sequence[Measurement], found: Solution, estimator: str) -> list[str]:
    """Return a line for each measurement whose position noise biases least squares."""
    if estimator not in ("ls", "wls"):
        return []
    out = []
    values = found.values[: len(found.structure.parameters)]
    for measured in measurements:
        added, known = _torque_of_position_noise(measured, found.structure, values), measured.averaged_variance
        share = np.divide(added, known, out=np.zeros_like(added), where=known > 0)  # of none nothing is a share
        worst = int(np.argmax(share))
        if share[worst] > _TORQUE:
            out.append(
                f"{measured.source}: position noise adds {100.0 * share[worst]:.0f} % to the torque noise variance of"
                f" {measured.joints[worst]} and biases {estimator}; --estimator ml takes it into account"
            )
    return out

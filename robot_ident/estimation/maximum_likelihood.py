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

import numpy as np

from robot_ident.errors import InputError
from robot_ident.estimation.equations import Equations
from robot_ident.estimation.problem import Problem, Solution, solution, with_inner
from robot_ident.model.derivatives import torque_derivatives
from robot_ident.model.structure import Structure
from robot_ident.recording.measurement import Measurement
from robot_ident.signals.motion import Array, Mask, Motion

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

    basis: tuple[Array, Array, Array]
    joint: np.ndarray
    variance: Array
    motion: Motion

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
        parts: list[tuple[Array, Array, Array]] = []
        joint: list[np.ndarray] = []
        variance: list[Array] = []
        for index in range(lines.shape[1]):
            k = np.flatnonzero(lines[1:, index]) + 1
            w = 2.0 * np.pi * measured.base_frequency * k
            c, s = np.cos(w * t), np.sin(w * t)
            one, zero = np.ones((samples, 1)), np.zeros((samples, 1))
            parts.append(
                (
                    np.hstack([one, c, s]),
                    np.hstack([zero, -w * s, w * c]),
                    np.hstack([zero, -w * w * c, -w * w * s]),
                )
            )
            joint.append(np.full(2 * len(k) + 1, index))
            size = max(float(noise[index]), 1e-24) / samples
            variance.append(np.concatenate([[size], np.tile(2.0 * size * share[k, index], 2)]))
        b0, b1, b2 = (np.hstack([part[order] for part in parts]) for order in range(3))
        return cls((b0, b1, b2), np.concatenate(joint), np.concatenate(variance), measured.motion)

    def moved(self, delta: Array) -> Motion:
        """Return the measured motion plus the lines delta [d]."""
        parts = []
        for base, whole in zip(self.basis, (self.motion.q, self.motion.dq, self.motion.ddq), strict=True):
            add = np.column_stack([base @ (delta * (self.joint == j)) for j in range(whole.shape[1])])
            parts.append(whole + add)
        return replace(self.motion, q=parts[0], dq=parts[1], ddq=parts[2])

    def torque_slope(self, structure: Structure, motion: Motion, values: Array) -> tuple[Array, tuple[str, ...]]:
        """Return d tau / d delta [N, n, d], and which effects it neglects."""
        slopes = torque_derivatives(structure, motion, values)
        b0, b1, b2 = self.basis
        out = slopes.position[:, :, self.joint] * b0[:, None, :]
        out += slopes.velocity[:, :, self.joint] * b1[:, None, :]
        out += slopes.acceleration[:, :, self.joint] * b2[:, None, :]
        return out, slopes.neglected


@dataclass(frozen=True)
class State:
    """A point of the search: inner parameters in the structure, theta [p], delta of each measurement, and its cost."""

    structure: Structure
    values: Array
    delta: tuple[Array, ...]
    problem: Problem
    equations: Equations
    cost: float

    @property
    def residual(self) -> Array:
        """Torque minus model [R] Nm."""
        out: Array = self.equations.torque - self.equations.phi @ self.values
        return out


@dataclass(frozen=True)
class Step:
    """A Levenberg-Marquardt step: of theta and free inner parameters [a], of each delta, and the Schur complement."""

    theta: Array
    delta: tuple[Array, ...]
    information: Array
    predicted: float


@dataclass(frozen=True)
class Normal:
    """The arrow: F_tt [a, a], gradient [a]; of each measurement F_td [a, d], F_dd [d, d] with prior, gradient [d]."""

    own: Array
    slope: Array
    cross: tuple[Array, ...]
    inner: tuple[Array, ...]
    inner_slope: tuple[Array, ...]

    def step(self, damping: float) -> Step:
        """Solve with the diagonals enlarged by 1 + damping."""
        from scipy.linalg import cho_factor, cho_solve

        own, slope = self.own + damping * np.diag(np.diag(self.own)), self.slope.copy()
        held = []
        for cross, inner, right in zip(self.cross, self.inner, self.inner_slope, strict=True):
            factored = cho_factor(inner + damping * np.diag(np.diag(inner)), lower=True)
            own = own - cross @ cho_solve(factored, cross.T)
            slope = slope - cross @ cho_solve(factored, right)
            held.append(factored)
        scale = np.sqrt(np.diag(own))
        theta = np.linalg.solve(own / np.outer(scale, scale), slope / scale) / scale
        delta = tuple(
            cho_solve(factored, right - cross.T @ theta)
            for factored, cross, right in zip(held, self.cross, self.inner_slope, strict=True)
        )
        gain = float(theta @ self.slope + sum(d @ g for d, g in zip(delta, self.inner_slope, strict=True)))
        return Step(theta, delta, own, gain)


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
    trajectories = [Trajectory.of(measured, start.structure, start.values[:p]) for measured in problem.measurements]
    state = _at(
        problem, trajectories, start.structure, start.values[:p], [np.zeros(len(t.joint)) for t in trajectories]
    )
    normal, neglected = _normal(trajectories, state)
    damping = 0.0
    for _ in range(_ITERATIONS):
        step = normal.step(damping)
        trial = _moved(problem, trajectories, state, step)
        if trial.cost <= state.cost * (1.0 + 1e-12):
            state, damping = trial, 0.1 * damping if damping > 1e-8 else 0.0
            normal, _ = _normal(trajectories, state)
            if step.predicted < _TOLERANCE:
                break
        else:
            damping = max(10.0 * damping, 1e-4)
            if damping > 1e8:
                break
    return _finished(state, start, normal, neglected)


def _at(
    problem: Problem, trajectories: Sequence[Trajectory], structure: Structure, values: Array, delta: Sequence[Array]
) -> State:
    measurements = [
        replace(measured, motion=trajectory.moved(d))
        for measured, trajectory, d in zip(problem.measurements, trajectories, delta, strict=True)
    ]
    here = problem.moved(measurements, structure)
    equations = here.equations(structure, values)
    noise = problem.noise
    residual = noise.whiten(equations.torque - equations.phi @ values)
    prior = sum(float(np.sum(d * d / t.variance)) for d, t in zip(delta, trajectories, strict=True))
    cost = float(np.sum(noise.independent * residual**2)) + prior
    return State(structure, values, tuple(delta), here, equations, cost)


def _moved(problem: Problem, trajectories: Sequence[Trajectory], state: State, step: Step) -> State:
    p = len(state.values)
    delta = [old + new for old, new in zip(state.delta, step.delta, strict=True)]
    structure = state.structure
    if len(step.theta) > p:
        settings, bounds = structure.settings.copy(), _inner_bounds(structure)
        free = bounds[2]
        settings[free] = np.clip(settings[free] + step.theta[p:], bounds[0][free], bounds[1][free])
        structure = structure.with_settings(settings)
    return _at(problem, trajectories, structure, state.values + step.theta[:p], delta)


def _inner_bounds(structure: Structure) -> tuple[Array, Array, np.ndarray]:
    inner = [inner for effect in structure.effects for inner in effect.inner]
    free = np.array([i.continuous for i in inner], dtype=bool)
    return np.array([i.lower for i in inner]), np.array([i.upper for i in inner]), free


def _normal(trajectories: Sequence[Trajectory], state: State) -> tuple[Normal, tuple[str, ...]]:
    """Return the normal equations at a point and the effects whose dependence on the trajectory is neglected."""
    noise = state.problem.noise
    jacobian, _ = with_inner(state.problem, state.structure, state.values, state.equations)
    root = np.sqrt(noise.independent)
    theta_rows = noise.whiten(jacobian) * root[:, None]
    residual = noise.whiten(state.residual) * root
    cross, inner, slopes = [], [], []
    neglected: tuple[str, ...] = ()
    for block, (measured, trajectory, delta) in enumerate(
        zip(state.problem.measurements, trajectories, state.delta, strict=True)
    ):
        slope, neglected = trajectory.torque_slope(state.structure, measured.motion, state.values)
        slope = measured.passed(slope)
        rows = state.equations.block == block
        whole = np.zeros((len(rows), slope.shape[2]))
        whole[rows] = slope[state.equations.sample[rows], state.equations.joint[rows]]
        whole = (noise.whiten(whole) * root[:, None])[rows]
        cross.append(theta_rows[rows].T @ whole)
        inner.append(whole.T @ whole + np.diag(1.0 / trajectory.variance))
        slopes.append(whole.T @ residual[rows] - delta / trajectory.variance)
    own = theta_rows.T @ theta_rows
    return Normal(own, theta_rows.T @ residual, tuple(cross), tuple(inner), tuple(slopes)), neglected


def _finished(state: State, start: Solution, normal: Normal, neglected: tuple[str, ...]) -> Solution:
    """Return the solution at the optimum with the Cramer-Rao bound and what ml changed."""
    found = solution(state.problem, state.structure, state.values, state.equations)
    information = normal.step(0.0).information
    scale = np.sqrt(np.diag(information))
    bound = np.linalg.inv(information / np.outer(scale, scale)) / np.outer(scale, scale)
    _, place = with_inner(state.problem, state.structure, state.values, state.equations)
    covariance = np.zeros_like(found.covariance)
    # coloured noise that is not weighed by its inverse: what it adds to the bound is added here
    plain = np.linalg.inv(normal.own / np.outer(scale, scale)) / np.outer(scale, scale)
    excess = found.covariance[np.ix_(place, place)] - plain if not state.problem.noise.weighs else 0.0
    covariance[np.ix_(place, place)] = bound + excess
    notes = [*found.notes, _comparison(found.values, start, covariance)]
    if neglected:
        notes.append(f"ml holds the columns of {', '.join(neglected)} at the estimated trajectory, without their slope")
    return replace(
        found,
        covariance=covariance,
        chi_square=state.cost,
        notes=tuple(notes),
    )


def _comparison(values: Array, start: Solution, covariance: Array) -> str:
    """Return in a line whether and where the estimate differs from weighted least squares."""
    names = [p.name for p in (*start.structure.parameters, *start.structure.inner)]
    sigma = np.sqrt(np.diag(covariance))
    shift = np.abs(values - start.values) / np.where(sigma > 0, sigma, np.inf)
    order = np.argsort(-shift)
    moved = [f"{names[k]} {shift[k]:.2g}" for k in order[:5] if shift[k] > _TELL]
    if moved:
        return f"ml differs from wls, in standard deviations: {', '.join(moved)}: position noise matters here"
    return f"ml agrees with wls within {shift.max():.2g} standard deviations: position noise does not matter here"

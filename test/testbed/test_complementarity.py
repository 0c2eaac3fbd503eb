"""The coupled friction problem is solved whatever the number of axes: residuals of random problems and known cases."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import pytest

from robot_ident.signals.motion import Array
from robot_ident.testbed.dry_friction import StepProblem, _Dual, solve

H = 1 / 1500


def solver_function(n: int) -> Any:
    """Return the CasADi function (A, F, v, c, h, phi, J) -> (lambda, w, v1, residual), all [n].

    The residual [Nm] is how far each lambda_i is from its own law when the others are as returned.
    """
    inertia, h = ca.SX.sym("A", n, n), ca.SX.sym("h")
    force, v, level, phi, jump = (ca.SX.sym(name, n) for name in ("F", "v", "c", "phi", "J"))
    problem = StepProblem(inertia, force, v, level, h, phi, jump)
    friction, w, after = solve(problem)
    dual = _Dual(problem)
    residual = ca.vertcat(*(friction[i] - dual.joint(i, friction)[0] for i in range(n)))
    return ca.Function("solve", [inertia, force, v, level, h, phi, jump], [friction, w, after, residual])


def chain_inertia(n: int, rng: np.random.Generator) -> Array:
    """Return an inertia like that of a serial arm: strongly coupled, the first axis a hundred times the last."""
    reach = np.tril(np.ones((n, n))) * rng.uniform(0.3, 1.0, (n, n))
    scale = np.outer(*2 * [rng.uniform(0.3, 3.0, n)])
    return reach.T @ np.diag(rng.uniform(0.05, 1.0, n)) @ reach * scale + 1e-3 * np.eye(n)


def solved(solver: Any, inertia: Array, force: Array, v: Array, level: Array) -> tuple[Array, Array, Array, Array]:
    """Return friction, mean acceleration, velocity after and residual, for a force without a jump."""
    n = len(v)
    friction, w, after, residual = solver(inertia, force, v, level, H, np.ones(n), np.zeros(n))
    return tuple(np.array(x).ravel() for x in (friction, w, after, residual))  # type: ignore[return-value]


@pytest.mark.parametrize("n", [1, 3, 6, 7])
def test_one_joint_stops_or_turns(n: int) -> None:
    """What happens in practice: one joint changes while the others slip on."""
    rng, solver = np.random.default_rng(n), solver_function(n)
    residuals = []
    for _ in range(400):
        inertia, level = chain_inertia(n, rng), rng.uniform(0.5, 3.0, n)
        v = rng.choice([-1.0, 1.0], n)
        v[rng.integers(n)] = rng.choice([0.0, 1.0]) * rng.normal(0.0, 5 * H)
        force = rng.normal(0.0, 3.0, n)
        friction, w, after, residual = solved(solver, inertia, force, v, level)
        residuals.append(np.abs(residual).max())
        assert np.all(np.abs(friction) <= level + 1e-9)
        np.testing.assert_allclose(inertia @ w + friction, force, atol=1e-8)
    assert max(residuals) < 1e-7


@pytest.mark.parametrize("n", [1, 3, 6, 7])
def test_joints_at_rest_break_away_one_after_the_other(n: int) -> None:
    """A joint whose force exceeds its friction leaves in its direction; those that it doesn't drag along have v = 0
    exactly.
    """
    rng, solver = np.random.default_rng(n), solver_function(n)
    for _ in range(200):
        inertia, level = chain_inertia(n, rng), rng.uniform(0.5, 3.0, n)
        force = rng.uniform(-0.9, 0.9, n) * level
        j = rng.integers(n)
        force[j] = 1.001 * level[j] * rng.choice([-1, 1])
        friction, _, after, residual = solved(solver, inertia, force, np.zeros(n), level)
        assert np.abs(residual).max() < 1e-7
        assert after[j] * force[j] > 0
        assert friction[j] == pytest.approx(level[j] * np.sign(force[j]))
        stays = after == 0
        assert np.all(np.abs(friction) <= level + 1e-8)
        np.testing.assert_allclose(friction[~stays], (level * np.sign(after))[~stays], atol=1e-8)


def test_no_joint_moves_below_its_friction() -> None:
    rng, solver = np.random.default_rng(0), solver_function(7)
    for _ in range(200):
        level = rng.uniform(0.5, 3.0, 7)
        force = rng.uniform(-0.999, 0.999, 7) * level
        friction, _, after, residual = solved(solver, chain_inertia(7, rng), force, np.zeros(7), level)
        assert not after.any()
        assert np.abs(residual).max() < 1e-7
        np.testing.assert_allclose(friction, force, atol=1e-8)


@pytest.mark.parametrize("n", [3, 7])
def test_repeated_steps_solve_what_one_does_not(n: int) -> None:
    """Torques far beyond friction from one step to the next, all joints at once: soon the law holds again."""
    rng, solver = np.random.default_rng(n), solver_function(n)
    for _ in range(60):
        inertia, level = chain_inertia(n, rng), rng.uniform(0.5, 3.0, n)
        v, force = np.zeros(n), rng.uniform(-1.5, 1.5, n) * level
        for _ in range(8):
            _, _, v, residual = solved(solver, inertia, force, v, level)
        assert np.abs(residual).max() < 1e-7

"""The optimiser's smooth criteria against the exact ones, and their derivatives against differences."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
import pytest

from robot_ident.design.criteria import evaluate
from robot_ident.design.family import SIGN_WIDTH, Setting, family_of
from robot_ident.design.local_search import random_start
from robot_ident.design.program import (
    Problem,
    inverse_factor_function,
    log_det_function,
    smooth_log_condition,
    smooth_sign,
)
from robot_ident.limits.feasibility import allowed_poses
from robot_ident.limits.interval import Batch
from robot_ident.model.expressions import columns_function
from robot_ident.model.structure import Structure
from robot_ident.robot import Robot
from robot_ident.signals.motion import Motion


@pytest.fixture(scope="module")
def setting(kuka: Robot) -> Setting:
    structure, family = Structure.build(kuka), family_of(0.1, 150.0)
    return Setting(
        robot=kuka,
        family=family,
        structure=structure,
        smooth=columns_function(structure, smooth_sign(SIGN_WIDTH * family.reachable_speed(kuka))),
        exact=columns_function(structure),
        variances=np.array([25.0, 26.0, 10.0]),
        criterion="d-optimal",
        poses=allowed_poses(kuka),
    )


def gradient_error(program: Any, x: np.ndarray) -> float:
    """Return the largest relative deviation of the gradient from central differences along random directions."""
    gradient = np.array(ca.Function("g", [program.x], [ca.gradient(program.cost, program.x)])(x)).ravel()
    rng, h, worst = np.random.default_rng(0), 1e-6, 0.0
    for _ in range(5):
        d = rng.normal(size=len(x))
        difference = (float(program.value(x + h * d)) - float(program.value(x - h * d))) / (2 * h)
        worst = max(worst, abs(gradient @ d - difference) / max(1.0, abs(difference)))
    return worst


def test_the_coarse_determinant_is_near_the_exact_one(setting: Setting) -> None:
    problem = Problem(setting)
    x = random_start(problem, np.random.default_rng(0), draws=3)
    exact, _ = problem.evaluate(problem.coefficients(x))
    assert float(problem.coarse.value(x)) == pytest.approx(exact, abs=0.6)  # the smooth sign costs a little
    assert gradient_error(problem.coarse, x) < 1e-5


def test_the_smooth_condition_number_bounds_the_exact_one(setting: Setting) -> None:
    problem = Problem(replace(setting, criterion="condition", floor=-43.0))
    x = random_start(problem, np.random.default_rng(1), draws=3)
    assert gradient_error(problem.coarse, x) < 1e-5
    assert problem.coarse.rows.shape[0] == problem.coarse.jacobian.size1_out("jac_g_x")


def test_smooth_condition_of_a_given_matrix() -> None:
    rng = np.random.default_rng(3)
    f = rng.normal(size=(60, 6)) * [1.0, 5.0, 0.2, 1.0, 3.0, 1.0]
    m = ca.MX.sym("m", 6, 6)
    log_det, inverse_factor = log_det_function(6), inverse_factor_function(6)
    smooth = ca.Function("smooth", [m], [smooth_log_condition(m, inverse_factor, doublings=5)])
    exact = np.log(np.linalg.cond(f / np.linalg.norm(f, axis=0)))
    value = float(smooth(f.T @ f))
    assert exact <= value <= exact + np.log(6.0) / 32 + 1e-9
    assert float(log_det(f.T @ f)) == pytest.approx(np.linalg.slogdet(f.T @ f)[1])


def test_the_smooth_sign_takes_the_width_of_its_joint() -> None:
    dq = ca.SX.sym("dq", 2)
    sign = smooth_sign(np.array([0.01, 1.0]))
    f = ca.Function("f", [dq], [sign(dq[0]), sign(dq[1]), sign(dq[0] + dq[1])])
    values = [float(v) for v in f([0.02, 0.5])]
    np.testing.assert_allclose(values, [np.tanh(2.0), np.tanh(0.5), np.tanh(0.52)])


def test_the_criteria_of_iterates_are_the_exact_ones(setting: Setting) -> None:
    problem = Problem(setting)
    coefficients = problem.coefficients(random_start(problem, np.random.default_rng(2), draws=3))
    expected = evaluate(Structure.build(setting.robot), problem.excitation(coefficients))
    log10_det, condition = problem.evaluate(coefficients)
    assert log10_det == pytest.approx(expected.log10_det_covariance, abs=1e-9)
    assert condition == pytest.approx(expected.condition_number, rel=1e-9)


def test_a_batch_gives_what_the_function_gives(setting: Setting) -> None:
    rng = np.random.default_rng(0)
    motion = Motion(*rng.normal(size=(3, 7, 3)))
    batch = Batch(setting.exact, 7)(motion)
    assert batch.shape == (7, 3, 21)
    for k in range(7):
        single = np.array(setting.exact(motion.q[k], motion.dq[k], motion.ddq[k]))
        np.testing.assert_allclose(batch[k], single, atol=1e-12)


def test_variables_and_coefficients_are_inverse(setting: Setting) -> None:
    problem = Problem(setting)
    x = np.random.default_rng(0).normal(size=33)
    np.testing.assert_allclose(problem.variables(problem.coefficients(x)), x, atol=1e-12)

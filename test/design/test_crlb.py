"""The Cramer-Rao bound as a criterion: what maximum likelihood reaches, and the paper's loop of design and estimate."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
import pytest

from robot_ident.design.design import DesignResult, _setting, design
from robot_ident.design.family import family_of
from robot_ident.design.local_search import random_start
from robot_ident.design.program import Problem
from robot_ident.design.target import Target
from robot_ident.errors import InputError
from robot_ident.estimation.identify import identify
from robot_ident.estimation.maximum_likelihood import information
from robot_ident.model.model import Model
from robot_ident.model.structure import Structure
from robot_ident.recording import Processing, Recording, process
from robot_ident.robot import Robot
from robot_ident.trajectories.excitation import Excitation

POSITION = 4e-3  # rad of a sample: an encoder so coarse that it matters
PERIODS = 4
BASE, RATE = 0.25, 50.0
PLAN: dict[str, Any] = {"base_frequency": BASE, "sample_rate": RATE, "harmonics": 3, "starts": 1, "workers": 1}


@pytest.fixture(scope="module")
def rough(kuka: Robot) -> Robot:
    """Return the KUKA with a coarse encoder and quiet torque."""
    return replace(
        kuka, noise=replace(kuka.noise, position_variance=np.full(3, POSITION**2), torque_variance=np.full(3, 4.0))
    )


def run(robot: Robot, excitation: Excitation, seed: int) -> Recording:
    """Return a recording of the exact motion, with the robot's noise."""
    rng, structure = np.random.default_rng(seed), Structure.build(robot)
    t = np.arange(PERIODS * excitation.samples_per_period) / excitation.sample_rate
    motion = excitation.series.motion(t)
    tau = structure.columns(motion) @ structure.true_values()
    q = motion.q + np.sqrt(robot.noise.position_variance) * rng.normal(size=motion.q.shape)
    return Recording(
        robot.joints,
        t,
        q,
        tau + np.sqrt(robot.noise.torque_variance) * rng.normal(size=tau.shape),
        source=f"run {seed}",
    )


def estimated(robot: Robot, recording: Recording, estimator: str = "ml") -> Model:
    processing = Processing(base_frequency=BASE, periodic=True)
    return identify([recording], robot, estimator=estimator, processing=processing)


@pytest.fixture(scope="module")
def first(rough: Robot) -> tuple[DesignResult, Recording, Model]:
    """Return the loop's first turn: a design that needs no estimate, its recording, the estimate."""
    found = design(
        rough,
        criterion="condition",
        **PLAN,
        determinant_floor=-20.0,
    )
    recording = run(rough, found.excitation, 1)
    return found, recording, estimated(rough, recording)


@pytest.mark.long
def test_the_loop_of_the_paper(rough: Robot, first: tuple[DesignResult, Recording, Model]) -> None:
    """Design by c1, run, estimate, redesign by the bound at the estimate, run again: the bound is what ml reports."""
    before, recording, model = first
    target = Target.of_model(model, periods=PERIODS)
    again = design(rough, criterion="crlb", target=target, **PLAN)
    assert again.margins.kept
    was = target.judge([before.excitation], bound=True)
    assert again.log10_det_covariance < was.log10_det_covariance - 0.5
    second = estimated(rough, run(rough, again.excitation, 2))
    np.testing.assert_allclose(second.std, again.sigma, rtol=0.15)
    plain = target.judge([again.excitation])
    assert np.max(again.sigma / plain.sigma) > 1.1, "the noise on positions counts"
    error = (second.values - Structure.build(rough).true_values()) / second.std
    assert np.sqrt(np.mean(error**2)) < 2.0


@pytest.mark.long
def test_the_bound_of_a_design_is_the_information_of_its_recording(
    rough: Robot, first: tuple[DesignResult, Recording, Model]
) -> None:
    found, recording, model = first
    target = Target.of_model(model, periods=PERIODS)
    measured = process(recording, rough, Processing(base_frequency=BASE, periodic=True))
    for bound in (False, True):
        told = information([measured], model.structure, model.linear, bound=bound)
        expected = target.judge([found.excitation], bound=bound)
        _, decades = np.linalg.slogdet(told)
        assert -decades / np.log(10.0) == pytest.approx(expected.log10_det_covariance, abs=1.0)


@pytest.mark.long
def test_criteria_of_iterates_agree_with_the_verdict(
    rough: Robot, first: tuple[DesignResult, Recording, Model]
) -> None:
    """Hold the program's CasADi slopes and one Cholesky against Pinocchio's slopes and a Schur complement."""
    target = Target.of_model(first[2], periods=PERIODS)
    problem = Problem(_setting(target, family_of(BASE, RATE, 3), "crlb"))
    x = random_start(problem, np.random.default_rng(0), draws=3)
    excitation = problem.excitation(problem.coefficients(x))
    expected = target.judge([excitation], bound=True).log10_det_covariance
    assert problem.evaluate(problem.coefficients(x)).log10_det == pytest.approx(expected, abs=1e-6)
    program = problem.coarse
    assert float(program.value(x)) == pytest.approx(expected, abs=0.8)  # the smooth sign costs a little
    gradient = np.array(ca.Function("g", [program.x], [ca.gradient(program.cost, program.x)])(x)).ravel()
    direction, h = np.random.default_rng(1).normal(size=len(x)), 1e-6
    slope = (float(program.value(x + h * direction)) - float(program.value(x - h * direction))) / (2 * h)
    assert gradient @ direction == pytest.approx(slope, rel=1e-5)


def test_no_noise_on_positions_leaves_the_plain_covariance(
    rough: Robot, first: tuple[DesignResult, Recording, Model]
) -> None:
    target = replace(Target.of_model(first[2]), position_variance=np.zeros(3))
    exact, plain = target.judge([first[0].excitation], bound=True), target.judge([first[0].excitation])
    np.testing.assert_allclose(exact.sigma, plain.sigma, rtol=1e-6)


def test_what_the_bound_needs_is_said(rough: Robot, first: tuple[DesignResult, Recording, Model]) -> None:
    with pytest.raises(InputError, match=r"crlb depends on the parameters: it needs a first estimate \(--model"):
        design(rough, criterion="crlb")
    silent = replace(Target.of_model(first[2]), position_variance=np.array([1e-6, np.nan, 1e-6]))
    with pytest.raises(InputError, match="that of joint_2 is unknown: give position_variance"):
        design(rough, criterion="crlb", target=silent)

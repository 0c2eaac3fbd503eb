"""A search that factorises anew only what moves finds what solving the whole problem finds."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.signal import lfilter

from robot_ident.errors import InputError
from robot_ident.estimation.equations import stack
from robot_ident.estimation.least_squares import factor
from robot_ident.estimation.problem import Problem
from robot_ident.estimation.solve import Projection
from robot_ident.model.structure import Structure
from robot_ident.recording import Measurement, Recording, process
from robot_ident.signals.filters import PeriodicLowPass
from robot_ident.signals.motion import Array

STRIBECK = ["stribeck@joint_1", "gravity_spring@joint_2", "stribeck@joint_3"]


def measured(arm: Any, pole: float) -> Measurement:
    """Return a short recording whose noise is white (pole 0) or coloured."""
    exact = arm.record(0, periods=4, lead=0.0, noise=0.0)
    white = np.random.default_rng(1).normal(size=exact.tau.shape) * np.sqrt(arm.robot.noise.torque_variance)
    tau = exact.tau + np.sqrt(1 - pole**2) * lfilter([1.0], [1.0, -pole], white, axis=0)
    return process(Recording(exact.names, exact.t, exact.q, tau), arm.robot)


def elsewhere(structure: Structure, rng: np.random.Generator) -> Structure:
    """Return a structure with its continuous inner parameters anywhere within their bounds."""
    inner = [inner for effect in structure.effects for inner in effect.inner]
    free = np.array([one.continuous for one in inner])
    lower, upper = (np.array([getattr(one, side) for one in inner]) for side in ("lower", "upper"))
    return structure.with_settings(np.where(free, rng.uniform(lower, upper), structure.settings))


def whole(problem: Problem, structure: Structure, near: Array | None) -> Array:
    """Return the residual [R] that a factorisation of all columns at once leaves."""
    equations = problem.equations(structure, near)
    values = problem.factored(equations.phi, problem.names).solve(problem.right(equations.torque))
    return problem.noise.whiten(equations.torque - equations.phi @ values)


@pytest.mark.parametrize("low_pass", [None, 20.0])
def test_what_is_kept_between_trials_changes_no_column(arm: Any, low_pass: float | None) -> None:
    effects = [*STRIBECK, "torque_scale@joint_2", "load_friction@joint_3", "base_tilt", "joint_elasticity@joint_1"]
    structure = Structure.build(arm.robot, effects)
    whole = measured(arm, 0.0)
    assert whole.base_frequency is not None
    passes = None if low_pass is None else PeriodicLowPass(low_pass, whole.base_frequency, whole.motion.samples)
    problem = Problem([replace(whole, low_pass=passes)], structure)
    rng = np.random.default_rng(3)
    values, twice = problem.linear(structure)[0], 0.5 * structure.true_values()
    for near in (values, None, twice, values):
        moved = elsewhere(structure, rng)
        kept, anew = problem.equations(moved, near), stack(problem.measurements, moved, near)
        np.testing.assert_allclose(kept.phi, anew.phi, atol=1e-12 * np.abs(anew.phi).max())
        assert np.array_equal(kept.torque, anew.torque)


@pytest.mark.parametrize("effects", [STRIBECK, [*STRIBECK, "load_friction@joint_3"]])
@pytest.mark.parametrize("weighted", [True, False])
@pytest.mark.parametrize("pole", [0.0, 0.9])
def test_the_residual_is_that_of_the_whole_problem(arm: Any, effects: list[str], weighted: bool, pole: float) -> None:
    structure = Structure.build(arm.robot, effects)
    problem = Problem([measured(arm, pole)], structure, weighted=weighted)
    searched = [effect.label for effect in structure.effects if effect.inner]
    left = Projection.of(problem, structure, searched)
    assert isinstance(left, Projection)
    rng = np.random.default_rng(2)
    for _ in range(3):
        moved = elsewhere(structure, rng)
        expected = whole(problem, moved, left.near)
        np.testing.assert_allclose(left.residual(moved), expected, atol=1e-9 * np.abs(expected).max())


def test_columns_that_stay_are_those_of_no_searched_effect(arm: Any) -> None:
    structure = Structure.build(arm.robot, [*STRIBECK, "load_friction@joint_3"])
    problem = Problem([measured(arm, 0.0)], structure)
    left = Projection.of(problem, structure, ["stribeck@joint_1"])
    assert isinstance(left, Projection)
    moving = [problem.names[k] for k in left.order[len(left.stays.scale) :]]
    assert {name.rpartition("@")[2] for name in moving} == {"joint_1", "joint_3"}
    assert all("stribeck" in name or "load" in name for name in moving)


def test_further_columns_are_factorised_beside_what_is_known() -> None:
    rng = np.random.default_rng(3)
    phi = rng.normal(size=(200, 9)) * 10.0 ** np.arange(-4, 5)
    phi[:, 8] += 1e5 * phi[:, 2]  # further columns that almost depend on the known ones
    torque = rng.normal(size=200)
    names = [f"p{k}" for k in range(9)]
    once = factor(phi, names, "data")
    known = factor(phi[:, :6], names[:6], "data")
    beside = known.solve_beside(phi[:, 6:], names, "data", torque)
    np.testing.assert_allclose(beside, once.solve(torque), rtol=1e-8)


@pytest.mark.parametrize(
    ("further", "said"), [(np.zeros(50), "does not excite p3"), (np.ones(50), "can't tell .*p3.* apart")]
)
def test_further_columns_that_tell_nothing_are_refused(further: Array, said: str) -> None:
    phi = np.column_stack([np.ones(50), *np.random.default_rng(4).normal(size=(2, 50))])
    known = factor(phi, ["p0", "p1", "p2"], "data")
    with pytest.raises(InputError, match=said):
        known.solve_beside(further[:, None], ["p0", "p1", "p2", "p3"], "data", np.ones(50))

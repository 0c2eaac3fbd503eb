"""The criteria as the paper defines them, against plain formulas."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from robot_ident.design.criteria import evaluate, evaluate_rows, noise_variances
from robot_ident.errors import InputError
from robot_ident.model.structure import Structure
from robot_ident.robot import Robot
from robot_ident.trajectories.excitation import Excitation


def test_definitions_against_plain_formulas() -> None:
    rng = np.random.default_rng(0)
    columns, variances = rng.normal(size=(40, 2, 5)) * [1.0, 10.0, 0.1, 3.0, 2.0], np.array([4.0, 0.25])
    f, s = columns.reshape(-1, 5), np.tile(variances, 40)
    covariance = np.linalg.inv(f.T @ np.diag(1 / s) @ f)
    weighted = f / np.sqrt(s)[:, None]
    found = evaluate_rows(weighted)
    assert found.log10_det_covariance == pytest.approx(np.log10(np.linalg.det(covariance)), abs=1e-10)
    np.testing.assert_allclose(found.sigma, np.sqrt(np.diag(covariance)), rtol=1e-10)
    expected = np.linalg.cond(weighted / np.linalg.norm(weighted, axis=0))
    assert found.condition_number == pytest.approx(expected, rel=1e-10)


def test_a_column_that_others_span_makes_everything_infinite() -> None:
    rows = np.random.default_rng(0).normal(size=(30, 3))
    for column in (rows[:, 0] - 2 * rows[:, 1], np.zeros(30)):
        rows[:, 2] = column
        found = evaluate_rows(rows)
        assert found.log10_det_covariance == found.condition_number == np.inf
        assert np.all(np.isinf(found.sigma))


def test_one_averaged_period_has_the_papers_variances(
    kuka: Robot, random_excitation: Callable[..., Excitation]
) -> None:
    structure, excitation = Structure.build(kuka), random_excitation(0)
    columns = structure.columns(excitation.samples())
    assert columns.shape == (1500, 3, 21)
    values = evaluate(structure, excitation)
    weighted = (columns / np.sqrt([25.0, 26.0, 10.0])[:, None]).reshape(-1, 21)
    assert values.log10_det_covariance == evaluate_rows(weighted).log10_det_covariance
    assert values.sigma.shape == (21,)
    single = evaluate(structure, excitation, periods=1)
    assert single.log10_det_covariance - values.log10_det_covariance == pytest.approx(21 * np.log10(16.0))
    assert single.condition_number == pytest.approx(values.condition_number)
    np.testing.assert_allclose(single.sigma, 4 * values.sigma)


def test_unknown_noise_is_weighted_by_the_torque_limit_and_said(kuka: Robot) -> None:
    noise = replace(kuka.noise, torque_variance=np.array([400.0, np.nan, 160.0]))
    variances, notes = noise_variances(replace(kuka, noise=noise))
    np.testing.assert_allclose(variances, [400.0, 4.43**2, 160.0])
    assert len(notes) == 1
    assert "joint_2" in notes[0]
    limits = replace(kuka.limits, torque=np.full(3, np.inf))
    with pytest.raises(InputError, match="joint_2.*torque_variance"):
        noise_variances(replace(kuka, noise=noise, limits=limits))


def test_zero_variance_is_refused(kuka: Robot) -> None:
    noise = replace(kuka.noise, torque_variance=np.array([400.0, 416.0, 0.0]))
    with pytest.raises(InputError, match="joint_3.* = 0"):
        noise_variances(replace(kuka, noise=noise))

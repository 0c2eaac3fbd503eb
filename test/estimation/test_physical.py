"""Physical consistency: Table I is recognised, the nearest set is near, the links give the model's torque."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pinocchio
import pytest

from robot_ident.estimation.identify import identify
from robot_ident.estimation.physical_consistency import (
    Nearest,
    nearest_physical,
    never_negative,
    projected_covariance,
    violations,
)
from robot_ident.estimation.solve import solve
from robot_ident.model.model_file import read_model, write_model
from robot_ident.model.structure import Structure
from robot_ident.recording import Recording, process
from robot_ident.robot import load_robot
from robot_ident.signals.motion import Motion

TABLE_1 = np.array(
    [45.38, -0.31, -2.22, -28.69, 0.3, -0.2, 3.36, 41.74, 0.07, 2.6, 8.21, 0.07, -0.21, 0.69, 7.63]
    + [17.76, 33.48, 23.11, 35.12, 6.35, 14.51]
)


def pseudo_inertias(standard: np.ndarray) -> list[np.ndarray]:
    out = []
    for m, mx, my, mz, xx, xy, yy, xz, yz, zz in standard.reshape(-1, 10):
        inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        h = np.array([[mx], [my], [mz]])
        out.append(np.block([[0.5 * np.trace(inertia) * np.eye(3) - inertia, h], [h.T, np.array([[m]])]]))
    return out


def test_table_1_is_recognised_and_the_inequality_named(arm: Any) -> None:
    (line,) = violations(arm.structure, TABLE_1)
    assert line.startswith("p15 >= p11 does not hold: 7.63 < 8.21")
    assert "link 3" in line


def test_the_robot_itself_is_possible(arm: Any) -> None:
    assert violations(arm.structure, arm.structure.true_values()) == ()
    spring = load_robot("kuka_ir361_spring")
    structure = Structure.build(spring)
    assert violations(structure, structure.true_values()) == ()


def test_negative_friction_is_named(arm: Any) -> None:
    values = arm.structure.true_values()
    values[arm.structure.names.index("viscous@joint_2")] = -1.5
    assert violations(arm.structure, values) == ("viscous@joint_2 = -1.5 is negative",)


def test_what_no_simple_inequality_shows_is_found_too(arm: Any) -> None:
    """A product of inertia larger than the moments allow."""
    values = arm.structure.true_values()
    values[arm.structure.names.index("p12")] = 2.0
    (line,) = violations(arm.structure, values)
    assert "no links can give" in line
    assert "p12" in line


def test_nearest_set_of_a_recording_of_table_1(arm: Any) -> None:
    """The sum of squares that the data pay is that of the distance, and no random feasible set is nearer."""
    t = np.arange(24000) / 150.0
    motion = arm.series.motion(t)
    rng = np.random.default_rng(0)
    tau = arm.structure.columns(motion) @ TABLE_1 + rng.normal(size=motion.q.shape) * [2.0, 2.0, 1.0]
    found = solve([process(Recording(arm.robot.joints, t, motion.q, tau), arm.robot)], arm.structure, "wls")
    nearest = nearest_physical(found)
    assert any("p15 >= p11" in note for note in nearest.notes)
    assert violations(arm.structure, nearest.solution.values) == ()
    for matrix in pseudo_inertias(nearest.inertias):
        assert np.linalg.eigvalsh(matrix).min() > 0
    metric = np.linalg.inv(found.covariance)
    step = nearest.solution.values - found.values
    assert nearest.distance**2 == pytest.approx(step @ metric @ step, rel=1e-6)
    assert nearest.distance > 3.0
    # the possible sets are convex: towards any of them the cost can only rise
    rise = metric @ step
    for _ in range(20):
        scale = rng.uniform(0.9, 1.1, 33) * np.concatenate([arm.robot.rigid.parameters, arm.robot.drives.armature])
        if min(np.linalg.eigvalsh(one).min() for one in pseudo_inertias(scale[:30])) > 0:
            other = np.concatenate([arm.structure.base.regrouping @ scale, nearest.solution.values[15:]])
            assert rise @ (other - nearest.solution.values) > -1e-3 * nearest.distance**2


def test_links_give_the_models_torque_and_survive_the_file(arm: Any, tmp_path: Path) -> None:
    model = identify([arm.record(3)], arm.robot, physical=True)
    write_model(model, tmp_path / "model.yaml")
    again = read_model(tmp_path / "model.yaml")
    inertias, rotors = again.physical_inertias, again.physical_rotors
    assert inertias is not None
    assert rotors is not None
    assert rotors[2] == 0.0
    body = pinocchio.Model(arm.robot.rigid.model)
    for link in range(3):
        body.inertias[1 + link] = pinocchio.Inertia.FromDynamicParameters(inertias[10 * link : 10 * link + 10])
    body.armature = rotors
    data = body.createData()
    state = np.random.default_rng(0).normal(size=(3, 50, 3))
    tau = np.array([pinocchio.rnea(body, data, *(x[k] for x in state)) for k in range(50)])
    columns = model.structure.columns(Motion(*state))[:, :, :15]
    np.testing.assert_allclose(tau, columns @ model.values[:15], atol=1e-8)


def test_what_must_not_be_negative_is_not_even_by_the_solvers_tolerance(arm: Any) -> None:
    """Pinocchio refuses a URDF with friction of -1e-9 Nm; precise data ask the solver for more than it holds."""
    structure, truth = arm.structure, arm.structure.true_values()
    covariance = 1e-4 * solve([process(arm.record(0), arm.robot)], structure, "wls").covariance
    friction = never_negative(structure)
    values = truth.copy()
    values[friction] = -1e-3 * np.arange(1, len(friction) + 1)
    x, nearest = Nearest.of(structure, values, covariance).to(values)
    assert np.all(nearest[friction] >= 0.0)
    assert np.all(x[30:33] >= 0.0)


def test_possible_parameters_stay_as_they_are(arm: Any) -> None:
    plain, physical = (identify([arm.record(0)], arm.robot, physical=word) for word in (False, True))
    assert any("physically possible as estimated" in note for note in physical.notes)
    np.testing.assert_allclose(physical.values, plain.values, atol=1e-4 * plain.std.max())
    assert plain.physical_inertias is None


@pytest.mark.long
def test_intervals_hold_for_projected_parameters(arm: Any) -> None:
    """The truth lies one sigma from the border p15 >= p11: estimates are thrown beyond it and projected back."""
    structure, truth = arm.structure, arm.structure.true_values()
    covariance = solve([process(arm.record(0), arm.robot)], structure, "wls").covariance
    program = Nearest.of(structure, truth, covariance)
    root, rng = np.linalg.cholesky(covariance), np.random.default_rng(5)
    inside, sharper = [], []
    for _ in range(12):
        values = program.to(truth + root @ rng.standard_normal(21))[1]
        found = projected_covariance(program, values, covariance)
        assert found is not None
        sigma = np.sqrt(np.diag(found))
        inside.append(np.abs(values - truth) < 1.96 * sigma)
        sharper.append(sigma / np.sqrt(np.diag(covariance)))
    assert 0.9 < np.mean(inside) <= 1.0
    ratio = dict(zip(structure.names, np.mean(sharper, axis=0), strict=True))
    assert ratio["p11"] < 0.97
    assert ratio["viscous@joint_1"] == pytest.approx(1.0, abs=0.03)


def test_covariance_far_from_any_border_is_that_of_the_data(arm: Any) -> None:
    structure, values = arm.structure, arm.structure.true_values().copy()
    values[structure.names.index("p11")] = 5.0
    covariance = np.diag((1e-3 * np.maximum(np.abs(values), 1.0)) ** 2)
    program = Nearest.of(structure, values, covariance)
    found = projected_covariance(program, values, covariance)
    assert found is not None
    np.testing.assert_allclose(found, covariance, atol=1e-5 * covariance.max())


def test_the_model_says_whose_covariance_it_has(arm: Any) -> None:
    model = identify([arm.record(3)], arm.robot, physical=True)
    plain = identify([arm.record(3)], arm.robot)
    assert model.physical is not None
    assert model.physical["covariance"] == "constrained"
    assert any("sigma counts in what is physically possible" in note for note in model.notes)
    p11 = model.structure.names.index("p11")
    assert model.std[p11] < 0.9 * plain.std[p11]

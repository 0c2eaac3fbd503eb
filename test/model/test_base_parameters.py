"""Base parameters: the paper's for the KUKA, by name and value, and a true base for any arm."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from robot_ident.model.base_parameters import random_states, reduce_to_base
from robot_ident.model.structure import Structure
from robot_ident.robot import load_robot
from robot_ident.signals.motion import Array, Motion

# Table I made physically possible (p11, p15), p1 to p15
TABLE_I = [45.38, -0.31, -2.22, -28.69, 0.3, -0.2, 3.36, 41.74, 0.07, 2.6, 7.65, 0.07, -0.21, 0.69, 7.73]


def test_kuka_has_the_papers_parameters_by_name_and_value() -> None:
    structure = Structure.build(load_robot())
    assert structure.names[:15] == tuple(f"p{k}" for k in range(1, 16))
    assert structure.names[15:] == tuple(f"{e}@joint_{j}" for e in ("viscous", "coulomb") for j in (1, 2, 3))
    np.testing.assert_allclose(structure.true_values()[:15], TABLE_I, atol=2.5e-3)
    np.testing.assert_allclose(structure.true_values()[15:], [17.76, 33.48, 23.11, 35.12, 6.35, 14.51])
    assert structure.parameters[0].meaning == "Izz1 + Iyy2 + 0.2304 m3 + Iyy3 + rotor1"
    assert structure.parameters[7].meaning == "Izz2 + 0.2304 m3 + rotor2"


def _table_i_torque(motion: Motion, p: Array) -> Array:
    """The gravity torque of Table I, written out by hand from its potential energy."""
    q2, q23 = motion.q[:, 1], motion.q[:, 1] + motion.q[:, 2]
    third = 9.81 * (p[8] * np.cos(q23) - p[9] * np.sin(q23))
    second = 9.81 * (-p[1] * np.sin(q2) - p[2] * np.cos(q2)) + third
    return np.column_stack([0 * q2, second, third])


def test_gravity_is_the_papers_potential() -> None:
    structure = Structure.build(load_robot())
    rng = np.random.default_rng(0)
    still = Motion(rng.uniform(-1, 1, (50, 3)), np.zeros((50, 3)), np.zeros((50, 3)))
    p = rng.normal(size=21)
    np.testing.assert_allclose(structure.columns(still) @ p, _table_i_torque(still, p), atol=1e-11)


def test_base_spans_what_all_parameters_span(robots_folder: Path) -> None:
    for name, count in (
        ("kuka_ir361", 15),
        (robots_folder / "ur_description/urdf/ur10_robot.urdf", 36),
        (robots_folder / "ur_description/urdf/ur5_robot.urdf", 36),
    ):
        robot = load_robot(name)
        base = reduce_to_base(robot)
        y = robot.rigid.regressor(random_states(robot))
        full, chosen = y.reshape(-1, 10 * robot.n), y[:, :, list(base.columns)].reshape(-1, len(base.columns))
        assert len(base.columns) == count == np.linalg.matrix_rank(full, tol=1e-9 * np.linalg.norm(full))
        outside = full - chosen @ np.linalg.lstsq(chosen, full, rcond=None)[0]
        assert np.abs(outside).max() < 1e-9 * np.abs(full).max()


@pytest.mark.parametrize("name", ["kuka_ir361", "ur"])
def test_regrouped_values_give_the_same_torque(name: str, request: pytest.FixtureRequest) -> None:
    if name == "ur":
        name = str(request.getfixturevalue("robots_folder") / "ur_description/urdf/ur10_robot.urdf")
    robot = load_robot(name)
    base = reduce_to_base(robot)
    motion = random_states(robot)
    values = base.values(robot.rigid.parameters, np.zeros(robot.n))
    tau = robot.rigid.regressor(motion)[:, :, list(base.columns)] @ values
    expected = robot.rigid.regressor(motion) @ robot.rigid.parameters
    np.testing.assert_allclose(tau, expected, atol=1e-7 * np.abs(expected).max())


def test_rotor_three_is_an_effect_of_its_own() -> None:
    assert reduce_to_base(load_robot()).free_rotors == (2,)
    structure = Structure.build(load_robot(), ["rotor_inertia@joint_3"])
    assert structure.names[-1] == "rotor_inertia@joint_3"


def test_reduction_is_the_same_every_time() -> None:
    first, second = reduce_to_base(load_robot()), reduce_to_base(load_robot())
    np.testing.assert_array_equal(first.regrouping, second.regrouping)


def test_spring_robot_has_25_parameters_and_the_springs_linear_part_in_p2() -> None:
    structure = Structure.build(load_robot("kuka_ir361_spring"))
    assert len(structure.parameters) == 25
    truth = dict(zip(structure.names, structure.true_values(), strict=True))
    assert truth["gravity_spring@joint_2"] == pytest.approx(3.2192, abs=1e-4)
    assert truth["p2"] == pytest.approx(30.0 - 13137 * 0.488 * 0.1 / 9.81, abs=2e-3)
    assert truth["torque_offset@joint_1"] == -12.72

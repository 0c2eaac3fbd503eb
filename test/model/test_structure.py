"""Columns of a model: numbers and expressions agree, and a mistake in an effect's name is one clear line."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from robot_ident.errors import InputError
from robot_ident.model.expressions import columns_function
from robot_ident.model.structure import Structure
from robot_ident.robot import load_robot
from robot_ident.signals.motion import Motion


@pytest.mark.parametrize(
    ("robot", "effects"),
    [
        ("kuka_ir361", []),
        ("kuka_ir361", ["torque_offset@joint_2", "wrist_coupling@joint_3"]),
        ("kuka_ir361_spring", []),
        ("kuka_ir361", ["torque_scale@joint_2", "external_force@joint_3", "torque_offset@joint_2"]),
    ],
)
def test_symbolic_columns_are_the_numeric_ones(robot: str, effects: list[str]) -> None:
    structure = Structure.build(load_robot(robot), effects)
    structure = structure.with_settings(1.3 * structure.settings)  # a torque scale other than 1
    motion = Motion(*np.random.default_rng(5).uniform(-1, 1, (3, 30, 3)))
    phi, numeric = columns_function(structure), structure.columns(motion)
    assert numeric.shape == (30, 3, len(structure.parameters))
    for k in range(motion.samples):
        np.testing.assert_allclose(np.array(phi(motion.q[k], motion.dq[k], motion.ddq[k])), numeric[k], atol=1e-10)


@pytest.mark.parametrize(
    ("label", "words"),
    [
        ("viscos@joint_1", "did you mean 'viscous'"),
        ("torque_offset@joint1", "did you mean 'joint_1'"),
        ("torque_offset", "needs its joint"),
        ("viscous@joint_1", "in the model already"),
        ("rotor_inertia@joint_1", "merges with p1"),
        ("gravity_spring@joint_1", "gravity does not load"),
        ("wrist_coupling@joint_1", "no joint before it"),
    ],
)
def test_an_effect_that_can_not_be_added_is_one_line(label: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        Structure.build(load_robot(), [label])


def test_a_rotor_that_no_parameter_holds_is_told() -> None:
    robot = load_robot()
    robot = replace(robot, drives=replace(robot.drives, armature=np.array([4.0, 6.0, 1.5])))
    (line,) = Structure.build(robot).rotors_left_out
    assert "joint_3: its armature, 1.5 kg m^2" in line
    assert "--effect rotor_inertia@joint_3" in line
    assert not Structure.build(robot, ["rotor_inertia@joint_3"]).rotors_left_out
    assert not Structure.build(load_robot()).rotors_left_out


def test_true_torque_is_inverse_dynamics_plus_friction() -> None:
    robot = load_robot()
    structure = Structure.build(robot)
    motion = Motion(*np.random.default_rng(6).uniform(-1, 1, (3, 40, 3)))
    friction = np.array([17.76, 33.48, 23.11]) * motion.dq + np.array([35.12, 6.35, 14.51]) * np.sign(motion.dq)
    expected = robot.rigid.inverse_dynamics(motion) + friction
    np.testing.assert_allclose(structure.columns(motion) @ structure.true_values(), expected, atol=1e-10)


def test_the_places_of_an_effect_are_those_that_its_names_have() -> None:
    load = "load_friction@joint_2"
    structure = Structure.build(load_robot("kuka_ir361"), ["cable@joint_3", load, "stribeck@joint_1"])
    for effect, own in structure.placed:
        assert structure.names[own] == effect.parameter_names()
    of_torque = structure.places_of(lambda effect: effect.uses_torque)
    expected = structure.effects[structure.labels.index(load)].parameter_names()
    assert tuple(np.array(structure.names)[of_torque]) == expected


def test_a_structure_with_fewer_effects_has_the_columns_that_they_had() -> None:
    structure = Structure.build(load_robot("kuka_ir361"), ["cable@joint_3", "stribeck@joint_1"])
    fewer, kept = structure.with_only(lambda effect: effect.name != "cable")
    assert fewer.labels == tuple(label for label in structure.labels if label != "cable@joint_3")
    assert fewer.given == structure.given
    assert fewer.names == tuple(np.array(structure.names)[kept])
    assert [inner.effect for inner in fewer.inner] == ["stribeck"] * len(fewer.inner)
    rng = np.random.default_rng(5)
    motion = Motion(*rng.uniform(-1.0, 1.0, (3, 20, 3)), dt=0.1)
    np.testing.assert_array_equal(fewer.columns(motion), structure.columns(motion)[:, :, kept])
    plain, _ = structure.with_only(lambda effect: effect.name != "coulomb")
    assert plain.given == structure.given - 3

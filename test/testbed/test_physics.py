"""The phenomena of the plant: how they are given, and that the truth is what the model's structure says it is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from robot_ident.errors import InputError
from robot_ident.model.structure import Structure
from robot_ident.robot import Robot
from robot_ident.signals.motion import Motion
from robot_ident.testbed.phenomena import PHYSICS, make_physics, nominal_physics, plant_physics
from robot_ident.testbed.servo import Servo


def test_values_are_read(kuka: Robot) -> None:
    made = make_physics("stribeck@joint_2:stribeck=12.5,speed=0.1", kuka)
    assert made.label == "stribeck@joint_2"
    assert made.values == {"stribeck": 12.5, "speed": 0.1, "exponent": 1.0}
    assert make_physics("viscous@joint_1:20", kuka).values == {"viscous": 20.0}


def test_what_is_given_replaces_what_the_robot_has(kuka: Robot) -> None:
    physics = {p.label: p for p in plant_physics(kuka, ["viscous@joint_1:2", "torque_offset@joint_3:-4"])}
    assert len(physics) == 7
    assert physics["viscous@joint_1"].values == {"viscous": 2.0}
    assert physics["viscous@joint_2"].values == {"viscous": 33.48}
    assert physics["torque_offset@joint_3"].values == {"torque_offset": -4.0}
    assert {p.label: p.values for p in nominal_physics(kuka)}["viscous@joint_1"] == {"viscous": 17.76}


@pytest.mark.parametrize(
    ("label", "message"),
    [
        ("stribek@joint_1", "did you mean 'stribeck'"),
        ("stribeck@joint_9", "no joint 'joint_9'"),
        ("stribeck", "needs its joint: stribeck@joint_1"),
        ("stribeck@joint_1:sped=1", "did you mean 'speed'"),
        ("stribeck@joint_1:speed=fast", "speed = 'fast' is not a number"),
        ("stribeck@joint_1:speed=nan", "is not a number"),
        ("coulomb@joint_1:-3", "coulomb = -3.0 lies outside"),
        ("base_tilt@joint_1", "belongs to no joint: write it without @joint_1"),
        ("joint_coupling@joint_1:other=1", "number of another joint"),
    ],
)
def test_what_cannot_be_is_refused(kuka: Robot, label: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        plant_physics(kuka, [label])


def test_the_same_twice_is_refused(kuka: Robot) -> None:
    with pytest.raises(InputError, match="given twice"):
        plant_physics(kuka, ["viscous@joint_1:2", "viscous@joint_1:3"])


def test_a_robot_that_lacks_a_value_is_refused(kuka_spring: Robot) -> None:
    broken = replace(kuka_spring, simulation={"gravity_spring": {"joint_2": {"stiffness": 1.0}}})
    with pytest.raises(InputError, match=r"simulation.gravity_spring.joint_2 lacks 'free_length'"):
        nominal_physics(broken)


@pytest.mark.parametrize("name", sorted(PHYSICS))
def test_typical_values_are_valid_and_felt(kuka_spring: Robot, name: str) -> None:
    made = make_physics(name if PHYSICS[name].scope == "robot" else f"{name}@joint_2", kuka_spring)
    assert PHYSICS[name](kuka_spring, made.place, made.values).values == made.values
    assert max(made.values.values()) > 0
    again = make_physics(made.text, kuka_spring)
    assert (again.label, again.values) == (made.label, made.values)


@pytest.mark.parametrize("name", ["kuka_ir361", "kuka_ir361_spring"])
def test_truth_is_what_the_structure_calls_true(name: str) -> None:
    """Two codes, one robot: the drive's inverse dynamics equal the model's columns times its true values."""
    from robot_ident.robot import load_robot

    robot = load_robot(name)
    rng = np.random.default_rng(0)
    motion = Motion(*rng.uniform(-1, 1, (3, 200, robot.n)))
    smooth, level = Servo.make(robot).ahead(motion)
    structure = Structure.build(robot)
    expected = structure.columns(motion) @ structure.true_values()
    np.testing.assert_allclose(smooth + level * np.sign(motion.dq), expected, atol=1e-9)

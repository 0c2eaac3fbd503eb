"""`name@*`: an effect on every joint where the model lacks it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from robot_ident.errors import InputError
from robot_ident.model.structure import Structure
from robot_ident.robot import load_robot
from robot_ident.robot.robot import at_every_joint


def test_an_effect_is_put_on_every_joint_that_lacks_it(checkout: Path) -> None:
    robot = load_robot(checkout / "test/golden/inputs/six_axis.yaml")
    one = Structure.build(robot, ["torque_offset@joint_2"])
    every = one.with_further(["torque_offset@*"])
    assert sorted(set(every.labels) - set(one.labels)) == [f"torque_offset@joint_{k}" for k in (1, 3, 4, 5, 6)]
    rotors = Structure.build(robot, ["rotor_inertia@*"]).added
    assert [effect.joint for effect in rotors] == list(one.base.free_rotors)
    held = one.robot.rigid.holding_rotors
    assert [joint for joint in range(one.robot.n) if not held[joint]] == list(one.base.free_rotors)
    with pytest.raises(InputError, match="no joint's column is left"):
        every.with_further(["torque_offset@*"])


def test_joints_that_can_t_have_it_and_joints_that_are_named_are_left_out() -> None:
    robot = load_robot()
    springs = Structure.build(robot, ["gravity_spring@*"]).added  # gravity does not load joint_1
    assert [effect.label for effect in springs] == ["gravity_spring@joint_2", "gravity_spring@joint_3"]
    both = Structure.build(robot, ["torque_offset@*", "torque_offset@joint_2"]).added
    assert sorted(effect.label for effect in both) == [f"torque_offset@{joint}" for joint in robot.joints]
    assert at_every_joint(["stribeck@*:25,velocity=0.1", "stribeck@b:5"], ["a", "b", "c"]) == (
        "stribeck@a:25,velocity=0.1",
        "stribeck@c:25,velocity=0.1",
        "stribeck@b:5",
    )
    for name in ("gravity_sprung@*", "base_tilt@*"):
        with pytest.raises(InputError, match="did you mean|write it without"):
            Structure.build(robot, [name])


def test_the_first_joint_is_the_reference_of_torque_scales() -> None:
    robot = load_robot()
    for built in (
        Structure.build(robot, ["torque_scale@*"]),
        Structure.build(robot).with_further(["torque_scale@*"]),
        Structure.build(replace(robot, known_effects=at_every_joint(["torque_scale@*"], robot.joints))),
    ):
        assert built.joints_scaled == ("joint_2", "joint_3")
        assert "torque_scale@joint_1 is left out: this joint is the reference of the others" in built.notes
    assert {*Structure.build(robot, ["torque_scale@*", "torque_scale@joint_1"]).joints_scaled} == {"joint_1", "joint_3"}
    with pytest.raises(InputError, match="one of them is the reference; leave out joint_1"):
        Structure.build(robot, [f"torque_scale@{joint}" for joint in robot.joints])
    with pytest.raises(InputError, match="torque_scale@joint_1 is left out"):
        Structure.build(robot, ["torque_scale@*"]).with_further(["torque_scale@*"])

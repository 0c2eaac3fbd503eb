"""Some joints only: the base parameters of the others' pose, and nothing that the moving joints don't show."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from robot_ident.errors import InputError
from robot_ident.model.base_parameters import random_states
from robot_ident.model.structure import Structure
from robot_ident.robot import load_robot
from robot_ident.robot.locked_joints import hold, moving_joints
from robot_ident.signals.motion import Motion


@pytest.mark.parametrize("held", [("joint_1",), ("joint_2",), ("joint_1", "joint_2"), ("joint_3",)])
def test_torque_is_that_of_the_whole_arm_at_rest_there(arm: Any, held: tuple[str, ...]) -> None:
    angles = {name: 0.3 + 0.2 * k for k, name in enumerate(held)}
    moving = [name for name in arm.robot.joints if name not in held]
    part = hold(arm.robot, moving, angles)
    assert part.joints == tuple(moving)
    states = random_states(arm.robot)
    keep = [arm.robot.joint_index(name) for name in moving]
    q, dq, ddq = (np.array(x) for x in (states.q, states.dq, states.ddq))
    for name, angle in angles.items():
        joint = arm.robot.joint_index(name)
        q[:, joint], dq[:, joint], ddq[:, joint] = angle, 0.0, 0.0
    whole = arm.structure.columns(Motion(q, dq, ddq)) @ arm.structure.true_values()
    structure = Structure.build(part)
    alone = structure.columns(Motion(q[:, keep], dq[:, keep], ddq[:, keep])) @ structure.true_values()
    np.testing.assert_allclose(alone, whole[:, keep], rtol=0.0, atol=1e-6)  # regrouping rounds at 1e-8


def test_parameters_that_do_not_show_are_left_out(arm: Any) -> None:
    part = Structure.build(hold(arm.robot, ["joint_2", "joint_3"], {"joint_1": 0.4}))
    assert len(part.base.columns) == 6  # of two parallel axes under gravity
    assert not any("joint_1" in name for name in part.names)


def test_what_the_yaml_says_of_held_joints_goes(checkout: Path) -> None:
    robot = load_robot("kuka_ir361_spring")
    part = hold(robot, ["joint_1", "joint_3"], {"joint_2": 0.2})
    assert not any(label.endswith("@joint_2") for label in part.known_effects)
    assert "joint_2" not in part.springs
    assert part.limits.velocity.tolist() == robot.limits.velocity[[0, 2]].tolist()
    again = hold(hold(robot, ["joint_2", "joint_3"], {"joint_1": 0.1}), ["joint_3"], {"joint_2": 0.2})
    assert again.joints == ("joint_3",)


def test_names_are_checked(arm: Any) -> None:
    with pytest.raises(InputError, match="no joint 'joint_4'; did you mean"):
        moving_joints(arm.robot, "joint_2, joint_4")
    with pytest.raises(InputError, match="all of its joints would move"):
        hold(arm.robot, arm.robot.joints, {})
    with pytest.raises(InputError, match="none of its joints would move"):
        hold(arm.robot, [], dict.fromkeys(arm.robot.joints, 0.0))
    assert moving_joints(arm.robot, "joint_3,joint_1") == ("joint_1", "joint_3")

"""`name@*`: an effect on every joint where the model lacks it."""

from __future__ import annotations

from pathlib import Path

import pytest

from robot_ident.errors import InputError
from robot_ident.model.structure import Structure
from robot_ident.robot import load_robot


def test_an_effect_is_put_on_every_joint_that_lacks_it(checkout: Path) -> None:
    robot = load_robot(checkout / "test/golden/inputs/six_axis.yaml")
    one = Structure.build(robot, ["torque_offset@joint_2"])
    every = one.with_further(["torque_offset@*"])
    assert sorted(set(every.labels) - set(one.labels)) == [f"torque_offset@joint_{k}" for k in (1, 3, 4, 5, 6)]
    rotors = Structure.build(robot, ["rotor_inertia@*"]).added
    assert [effect.joint for effect in rotors] == list(one.base.free_rotors)
    with pytest.raises(InputError, match="no joint's column is left"):
        every.with_further(["torque_offset@*"])

"""Derivatives of torque against differences."""

from __future__ import annotations

import numpy as np
import pytest

from robot_ident.model.derivatives import torque_derivatives
from robot_ident.model.structure import Structure
from robot_ident.robot import load_robot
from robot_ident.signals.motion import Motion


@pytest.mark.parametrize(
    ("name", "effects"),
    [("kuka_ir361", ()), ("kuka_ir361_spring", ()), ("kuka_ir361", ("torque_scale@joint_2", "external_force@joint_3"))],
)
def test_derivatives_are_those_of_differences(name: str, effects: tuple[str, ...]) -> None:
    structure = Structure.build(load_robot(name), effects)
    structure = structure.with_settings(1.3 * structure.settings)
    rng = np.random.default_rng(0)
    values = structure.true_values() + rng.normal(size=len(structure.parameters))
    state = rng.normal(size=(3, 40, 3))
    state[1] += 0.2 * np.sign(state[1])  # away from the jump of Coulomb friction
    found = torque_derivatives(structure, Motion(*state), values)
    for order, slope in enumerate((found.position, found.velocity, found.acceleration)):
        for joint in range(3):
            ends = []
            for side in (-1e-5, 1e-5):
                moved = state.copy()
                moved[order, :, joint] += side
                ends.append(structure.columns(Motion(*moved)) @ values)
            numeric = (ends[1] - ends[0]) / 2e-5
            np.testing.assert_allclose(slope[:, :, joint], numeric, atol=1e-5 * np.abs(slope).max())
    assert found.neglected == ()

"""Base parameters whose torque cancels that of others many times over are named with where to look."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from robot_ident.estimation.driving import implausible_notes
from robot_ident.estimation.equations import stack
from robot_ident.recording import process


def test_a_first_moment_that_others_take_off_again_is_named(arm: Any) -> None:
    structure = arm.structure
    truth = structure.true_values()
    equations = stack([process(arm.record(1, periods=2), arm.robot)], structure)
    std = np.full(len(truth), 60.0)
    assert implausible_notes(structure, equations, truth, std) == []
    absurd = truth.copy()
    absurd[structure.names.index("p2")] = 1603.0
    (line,) = implausible_notes(structure, equations, absurd, std)
    assert line.startswith("no arm of this size has p2 = 1603 ± 60 kg m, whose torque would be")
    assert "URDF's axes" in line and "unit" in line
    assert implausible_notes(structure, equations, absurd, std * 20.0) == [], "unknown is not impossible"
    silent = replace(equations, torque=0.0 * equations.torque)
    assert implausible_notes(structure, silent, absurd, std) == []

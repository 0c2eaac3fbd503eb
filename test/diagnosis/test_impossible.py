"""What only a coefficient below zero would explain is not named; nor is what rounded positions imitate."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from robot_ident.diagnosis.diagnose import diagnose
from robot_ident.recording import Recording, process
from robot_ident.testbed.phenomena import plant_physics
from robot_ident.testbed.simulation import Play


@pytest.fixture(scope="module")
def recorded(bench: Any) -> list[Recording]:
    """Three recordings as they should be, of little noise."""
    plays = [Play.of(bench.robot, plant_physics(bench.robot, ()), bench.motions[k]) for k in range(3)]
    return [play.record(6, noise=0.1, seed=40 + k) for k, play in enumerate(plays)]


def named_with(recordings: list[Recording], bench: Any, inertia: float) -> list[str]:
    """Return what is named of recordings to which a rotor of an inertia kg m^2 was added on the last axis."""
    measured = [process(r, bench.robot) for r in recordings]
    rotor = [m.motion.ddq * [0.0, 0.0, inertia] for m in measured]
    added = [replace(m, torque=m.torque + more) for m, more in zip(measured, rotor, strict=True)]
    return [one.label for one in diagnose(added, bench.structure).missing]


@pytest.mark.long
def test_a_rotor_is_named_and_its_negative_is_not(bench: Any, recorded: list[Recording]) -> None:
    assert named_with(recorded, bench, 4.0) == ["rotor_inertia@joint_3"]
    assert "rotor_inertia@joint_3" not in named_with(recorded, bench, -4.0)


def test_a_clock_that_runs_wrong_is_no_rotor(bench: Any, recorded: list[Recording]) -> None:
    fast = [replace(r, t=1.5 * (r.t - r.t[0]), dq=None) for r in recorded[:2]]
    found = diagnose([process(r, bench.robot) for r in fast], bench.structure)
    assert "rotor_inertia@joint_3" not in [s.label for s in found.missing]
    assert not [p for s in found.missing for p in s.parameters if "rotor_inertia" in p.name and p.value < 0]
    assert "times too fast" in found.clock


def rounded(recordings: list[Recording], step: float = 1e-3) -> list[Recording]:
    return [replace(r, q=np.round(r.q / step) * step, dq=None) for r in recordings]


def test_rounded_positions_are_not_the_arm_s_fault(bench: Any, recorded: list[Recording]) -> None:
    found = diagnose([process(r, bench.robot) for r in rounded(recorded)], bench.structure)
    assert (found.verdict, found.missing) == ("adequate", ())

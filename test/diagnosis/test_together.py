"""More than one thing on a joint, clearances one beside the other, and what only recordings kept aside can tell."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from robot_ident.diagnosis.diagnose import diagnose

GAP = "backlash@joint_1"
OFFSET = "torque_offset@joint_1:torque_offset=3"
GAPS = {"joint_2": 0.87e-3, "joint_1": 0.61e-3}  # rad
ECCENTRIC = "encoder_eccentricity@joint_2:encoder_eccentricity=0.008,position=-0.17,harmonic=2"
AS_OF_16 = 6.0 / 16.0  # of the noise: six periods tell as much as sixteen of the paper's


@pytest.mark.long
def test_what_else_a_rattling_joint_lacks_is_found_beside_its_gap(bench: Any) -> None:
    found = diagnose(bench.measure((GAP, OFFSET), noise=1.0), bench.structure)
    assert {finding.label for finding in found.missing} == {GAP, "torque_offset@joint_1"}


@pytest.mark.long
def test_two_gaps_are_told_apart(bench: Any) -> None:
    effects = tuple(f"backlash@{joint}:gap={gap!r}" for joint, gap in GAPS.items())
    found = diagnose(bench.measure(effects, [0, 1], noise=AS_OF_16), bench.structure)
    assert {finding.label for finding in found.missing} == {f"backlash@{joint}" for joint in GAPS}
    for finding in found.missing:
        play = next(p for p in finding.parameters if p.name.startswith("backlash.gap"))
        assert play.value == pytest.approx(1e3 * GAPS[finding.label.partition("@")[2]], rel=0.45)


@pytest.mark.long
def test_an_effect_is_not_held_to_what_another_joint_lacks(bench: Any) -> None:
    measured = bench.measure(("backlash@joint_3:gap=0.0011", ECCENTRIC), noise=AS_OF_16)
    found = diagnose(measured, bench.structure)
    assert {finding.label for finding in found.missing} == {"backlash@joint_3", "encoder_eccentricity@joint_2"}


def test_a_stop_that_one_motion_reaches_is_named_where_another_kept_aside_does(bench: Any) -> None:
    farthest = [float(motion.motion(np.linspace(0, 10, 1000)).q[:, 0].max()) for motion in bench.motions]
    order = np.argsort(farthest)[::-1]
    position = 0.6 * farthest[order[2]] + 0.4 * farthest[order[1]]
    assert farthest[order[1]] - position > 0.03, "two of the four motions reach it, one of them barely"
    stop = (f"end_stop@joint_1:end_stop=150,position={position:.4f},direction=1",)
    training = bench.measure(stop, [int(order[k]) for k in (0, 2, 3)], noise=0.1)
    aside = bench.measure(stop, [int(order[1])], noise=0.1)
    told = diagnose(training, bench.structure, aside)
    assert [finding.label for finding in told.missing] == ["end_stop@joint_1"]
    (finding,) = told.missing
    assert finding.validation_after["joint_1"] < finding.validation_before["joint_1"]


@pytest.mark.long
@pytest.mark.parametrize("seed", [21, 22])
def test_recordings_kept_aside_bring_no_false_name(bench: Any, seed: int) -> None:
    found = diagnose(
        bench.measure((), noise=1.0, seed=seed), bench.structure, bench.measure((), [3], noise=1.0, seed=seed)
    )
    assert found.verdict == "adequate"
    assert not found.missing

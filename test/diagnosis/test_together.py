"""More than one thing on a joint, and what only recordings kept aside can tell."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from robot_ident.diagnosis.backlash import best_gap, gap_behind, muted
from robot_ident.diagnosis.candidates import Folds
from robot_ident.diagnosis.diagnose import diagnose
from robot_ident.diagnosis.evidence import gather
from robot_ident.diagnosis.scan import base_gram

GAP = "backlash@joint_1"
OFFSET = "torque_offset@joint_1:torque_offset=3"


def test_what_else_a_rattling_joint_lacks_is_found_between_the_bursts(bench: Any) -> None:
    found = diagnose(bench.measure((GAP, OFFSET), noise=1.0), bench.structure)
    assert {suspect.label for suspect in found.missing} == {GAP, "torque_offset@joint_1"}


def test_bursts_are_laid_to_the_joint_whose_gap_makes_them(bench: Any) -> None:
    evidence = gather(bench.measure((GAP,)), bench.structure)
    folds = Folds.of(base_gram(evidence))
    gap = gap_behind(evidence, folds, range(3), range(3))
    assert gap is not None
    assert gap.label == GAP
    assert best_gap(evidence, folds, [1]) is None or best_gap(evidence, folds, [1]).gain < 0.1 * gap.gain


def test_muted_time_counts_for_nothing(bench: Any) -> None:
    evidence = gather(bench.measure((GAP,)), bench.structure)
    less, unseen = muted(evidence, None, {0: [0]})
    assert unseen is None
    for before, after in zip(evidence.trajectories, less.trajectories, strict=True):
        gone = (before.weight[:, 0] > 0) & (after.weight[:, 0] == 0)
        assert 0.05 < gone.mean() < 0.8
        assert after.dof[0] < before.dof[0]
        assert np.all(after.y[gone, 0] == 0.0)
        np.testing.assert_array_equal(after.weight[:, 1:], before.weight[:, 1:])


def test_a_stop_that_one_motion_reaches_is_named_where_another_kept_aside_does(bench: Any) -> None:
    farthest = [float(motion.motion(np.linspace(0, 10, 1000)).q[:, 0].max()) for motion in bench.motions]
    order = np.argsort(farthest)[::-1]
    position = 0.6 * farthest[order[2]] + 0.4 * farthest[order[1]]
    assert farthest[order[1]] - position > 0.03, "two of the four motions reach it, one of them barely"
    stop = (f"end_stop@joint_1:end_stop=150,position={position:.4f},direction=1",)
    training = bench.measure(stop, [int(order[k]) for k in (0, 2, 3)], noise=0.1)
    aside = bench.measure(stop, [int(order[1])], noise=0.1)
    blind = diagnose(training, bench.structure)
    told = diagnose(training, bench.structure, aside)
    assert [suspect.label for suspect in told.missing] == ["end_stop@joint_1"]
    (suspect,) = told.missing
    assert suspect.validation_after["joint_1"] < suspect.validation_before["joint_1"]
    assert blind.verdict in ("unexplained", "missing")


@pytest.mark.parametrize("seed", [21, 22])
def test_recordings_kept_aside_bring_no_false_name(bench: Any, seed: int) -> None:
    found = diagnose(
        bench.measure((), noise=1.0, seed=seed), bench.structure, bench.measure((), [3], noise=1.0, seed=seed)
    )
    assert found.verdict == "adequate"
    assert not found.missing

"""Gaps one beside the other and beside effects, blows that noise hides one by one, and effects of a faint excess."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from robot_ident.diagnosis.backlash import best_gap
from robot_ident.diagnosis.diagnose import diagnose
from robot_ident.diagnosis.evidence import gather
from robot_ident.diagnosis.search import Search
from robot_ident.diagnosis.spectrum import whitened
from robot_ident.diagnosis.stage import Stage, choose, worthwhile

FAINT, FAINTER = "backlash@joint_3:gap=0.00055", "backlash@joint_3:gap=0.0004"
GAPS = {"joint_2": 0.87e-3, "joint_1": 0.61e-3}  # rad
ECCENTRIC = "encoder_eccentricity@joint_2:encoder_eccentricity=0.008,position=-0.17,harmonic=2"
AS_OF_16 = 6.0 / 16.0  # of the noise: six periods tell as much as sixteen of the paper's


def test_two_gaps_are_told_apart(bench: Any) -> None:
    effects = tuple(f"backlash@{joint}:gap={gap!r}" for joint, gap in GAPS.items())
    found = diagnose(bench.measure(effects, [0, 1], noise=AS_OF_16), bench.structure)
    assert {suspect.label for suspect in found.missing} == {f"backlash@{joint}" for joint in GAPS}
    for suspect in found.missing:
        play = next(p for p in suspect.parameters if p.name.startswith("backlash.gap"))
        assert play.value == pytest.approx(1e3 * GAPS[suspect.label.partition("@")[2]], rel=0.45)


def test_a_gap_is_seen_by_where_its_blows_are(bench: Any) -> None:
    measured = bench.measure((FAINTER,), [0, 1], noise=AS_OF_16)
    stage = Stage.of(whitened(gather(measured, bench.structure)))
    assert not any(fit.fails for fit in stage.fits), "noise hides the blows one by one"
    found = diagnose(measured, bench.structure)
    assert [suspect.label for suspect in found.missing] == ["backlash@joint_3"]


def test_an_effect_is_not_held_to_what_another_joint_lacks(bench: Any) -> None:
    measured = bench.measure((FAINT, ECCENTRIC), [0, 1], noise=AS_OF_16)
    found = diagnose(measured, bench.structure)
    assert {suspect.label for suspect in found.missing} == {"backlash@joint_3", "encoder_eccentricity@joint_2"}


def test_an_effect_has_to_help_its_own_joint_where_that_lacks_something(bench: Any) -> None:
    """Something else at joint 2 spoils parameters that joint 1 goes by: what leans on that is no eccentric encoder."""
    stage = Stage.of(whitened(gather(bench.measure((ECCENTRIC,), [0, 1], noise=AS_OF_16), bench.structure)))
    found = choose(stage)
    assert found is not None and found.label == "encoder_eccentricity@joint_2" and stage.fits[1].fails
    elsewhere = np.array([found.held_out_by_joint[1], -1.0, 0.0])
    assert worthwhile(replace(found, held_out_by_joint=elsewhere + [0.0, 2.0, 0.0]), stage, ())
    assert not worthwhile(replace(found, held_out_by_joint=elsewhere), stage, ())


def test_what_followed_a_gap_on_another_joint_is_dropped(bench: Any) -> None:
    """Joint 2's gap shakes joint 3: a delay that followed the shaking is no member once the gap is known."""
    evidence = gather(bench.measure(("backlash@joint_2:gap=0.0012",)), bench.structure)
    given = Stage.of(evidence)
    gap = best_gap(evidence, given.folds, [1])
    assert gap is not None
    search = Search(evidence, given)
    assert 2 in search._shaken(gap.effect)
    follower = max((s for s in given.scores if s.label == "time_delay@joint_3"), key=lambda s: s.gain)
    search.members = [follower]
    search._keep(gap, ())
    assert set(search.rattling) >= {1, 2}
    assert not search.members


def test_noise_is_nothing_that_an_effect_has_to_explain(bench: Any) -> None:
    faint = "stribeck@joint_1:stribeck=8,speed=0.09"
    missed = []
    for seed in range(1, 5):
        stage = Stage.of(whitened(gather(bench.measure((faint,), [0, 1], noise=AS_OF_16, seed=seed), bench.structure)))
        clear = np.asarray(stage.excess) > 0.0
        assert np.all(stage.surely[clear] < stage.excess[clear])
        chosen = choose(stage)
        missed += [] if chosen is not None and chosen.label == "stribeck@joint_1" else [seed]
    assert not missed

"""Is the truth named? The plant hides effects by formulas and a discretisation that are not the catalogue's."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from robot_ident.diagnosis.diagnose import diagnose
from robot_ident.estimation.identify import estimate
from robot_ident.model.structure import Structure
from robot_ident.recording import Processing, process

STRIBECK = "stribeck@joint_2:stribeck=20,speed=0.08"
LOAD = "load_friction@joint_2:load_friction=0.1"
OFFSET = "torque_offset@joint_3:torque_offset=5"
HOSE = "external_force@joint_3:stiffness=20,free_length=0.2,x=0.1,y=0.3,z=0.5"
"""Its formula is that of a rope; the catalogue has a constant force and a spring."""
HIDDEN = (
    (STRIBECK,),
    ("base_tilt:tilt_x=0.04,tilt_y=0.05",),
)
FURTHER = (
    (HOSE, STRIBECK),
    (LOAD,),
    (OFFSET,),
    ("rotor_inertia@joint_3:rotor_inertia=5",),
    ("viscous_asymmetric@joint_1:viscous_asymmetric=6",),
    ("backlash@joint_1",),
    (STRIBECK, OFFSET),
    (HOSE,),
)
BUMP = ("unknown_bump@joint_2:bump=25,position=0.1,width=0.08",)


def labels(effects: tuple[str, ...]) -> set[str]:
    return {effect.partition(":")[0] for effect in effects}


@pytest.mark.parametrize(
    "seed", [11, pytest.param(12, marks=pytest.mark.long), pytest.param(13, marks=pytest.mark.long)]
)
def test_nothing_hidden_is_adequate(bench: Any, seed: int) -> None:
    found = diagnose(bench.measure((), noise=1.0, seed=seed), bench.structure)
    assert found.verdict == "adequate"
    assert not found.missing
    assert found.unexplained is None


@pytest.mark.parametrize(
    "effects",
    [*HIDDEN, *(pytest.param(effects, marks=pytest.mark.long) for effects in FURTHER)],
    ids=lambda effects: "+".join(sorted(labels(effects))),
)
def test_what_is_hidden_is_named(bench: Any, effects: tuple[str, ...]) -> None:
    found = bench.diagnose(effects)
    assert found.verdict == "missing"
    assert {finding.label for finding in found.missing} == labels(effects)


@pytest.mark.parametrize("joint", ["joint_1", pytest.param("joint_3", marks=pytest.mark.long)])
def test_effort_that_is_half_a_sample_early_is_told(bench: Any, joint: str) -> None:
    """It shows in the one sample before a reversal that it carries across: too little to be sure of its size."""
    found = diagnose(bench.measure((f"time_delay@{joint}:time_delay=-0.003",)), bench.structure)
    assert (*found.missing, *found.others)[0].label == f"time_delay@{joint}"
    assert found.verdict in ("missing", "not_decidable")


def test_an_unknown_phenomenon_gets_no_name_but_a_place(bench: Any) -> None:
    found = bench.diagnose(BUMP)
    assert found.verdict == "unexplained"
    assert not found.missing
    assert found.unexplained is not None
    assert found.unexplained.joint == "joint_2"
    depends = found.unexplained.depends_on
    assert max(depends, key=lambda name: depends[name]) == "position"
    assert depends["position"] > 0.5
    assert "< q <" in found.unexplained.where
    assert "% of the excess" in found.unexplained.where
    assert found.remaining_rms["joint_2"] > 2.0


def test_adding_lowers_the_error_on_motion_that_no_fit_has_seen(bench: Any) -> None:
    (finding,) = bench.diagnose((STRIBECK,)).missing
    assert finding.validation_after["joint_2"] < 0.7 * finding.validation_before["joint_2"]
    assert finding.mse_after["joint_2"] < 0.7 * finding.mse_before["joint_2"]
    assert finding.explained > 0.8
    measured, (unseen,) = bench.measure((STRIBECK,)), bench.measure((STRIBECK,), [3], noise=1e-3)
    errors = []
    for structure in (bench.structure, Structure.build(bench.robot, [finding.effect])):
        model = estimate(measured, structure)
        errors.append(np.mean((unseen.torque - model.predict(unseen.motion))[unseen.used[:, 1], 1] ** 2))
    # what stays is the jerk of the breakaway: lines of its acceleration lie below the noise of the position
    assert errors[1] < 0.35 * errors[0]


def test_size_is_that_of_the_truth(bench: Any) -> None:
    (finding,) = bench.diagnose((OFFSET,)).missing
    (parameter,) = finding.parameters
    assert parameter.value == pytest.approx(5.0, abs=max(0.2, 5 * parameter.std))


@pytest.mark.long
def test_a_hose_is_told_with_its_stiffness(bench: Any) -> None:
    """It is slack below a free length, and pulls along itself: the spring of the catalogue is nearly as stiff."""
    (finding,) = bench.diagnose((HOSE,)).missing
    values = {one.name.partition("@")[0]: one.value for one in finding.parameters}
    assert values["external_force.k"] == pytest.approx(20.0, rel=0.15)
    assert values["external_force.Fy"] == pytest.approx(0.3 * 20.0, rel=0.25)
    assert finding.validation_after["joint_1"] < finding.validation_before["joint_1"]


def test_one_recording_works_and_is_said_to_be_weaker(bench: Any) -> None:
    found = diagnose(bench.measure((OFFSET,), [0]), bench.structure)
    assert [finding.label for finding in found.missing] == ["torque_offset@joint_3"]
    assert any("one trajectory only" in note for note in found.notes)


def test_without_periods_nothing_is_adequate(bench: Any) -> None:
    measured = process(bench.record((), 0), bench.robot, Processing(periodic=False))
    found = diagnose([measured], bench.structure)
    assert found.verdict == "not_decidable"
    assert not found.missing
    assert any("noise is unknown" in note for note in found.notes)
    assert set(found.remaining_rms) == set(bench.robot.joints)


def test_without_periods_an_effect_is_named_that_predicts_other_motion(bench: Any) -> None:
    recordings = [bench.record((STRIBECK,), place) for place in (0, 1)]
    measured = [process(recording, bench.robot, Processing(periodic=False)) for recording in recordings]
    found = diagnose(measured, bench.structure, [process(bench.record((STRIBECK,), 3), bench.robot)])
    assert found.verdict == "missing"
    assert found.missing[0].label == "stribeck@joint_2"
    assert found.missing[0].validation_after["joint_2"] < found.missing[0].validation_before["joint_2"]
    inner = {p.name: p for p in found.missing[0].parameters}
    assert inner["stribeck.vs@joint_2"].std > 0.0


def test_too_little_data_says_how_much_more(bench: Any) -> None:
    from robot_ident.diagnosis.power import ENOUGH, too_little
    from robot_ident.regression.evidence import gather

    evidence, best = gather(bench.measure(()), bench.structure), 11.0
    (said,) = too_little(best, evidence)
    more = int(said.partition("about ")[2].partition(" ")[0])
    periods = evidence.trajectories[0].measured.periods
    assert (periods + more) * best / periods >= ENOUGH > (periods + more - 1) * best / periods


def test_contract_of_the_result(bench: Any) -> None:
    found = bench.diagnose((STRIBECK,)).to_dict()
    listed = found["candidates"]
    assert [c["rank"] for c in listed] == list(range(1, len(listed) + 1))
    first = [(c["effect"], c["joint"]) for c in listed[: len(found["missing"])]]
    assert first == [(m["effect"], m["joint"]) for m in found["missing"]]
    for candidate in listed:
        assert 0.0 <= candidate["explained"] <= 1.0
        assert 0.0 <= candidate["p_value"] <= 1.0
        assert all("@" in label or label in ("base_tilt", "payload", "time_delay") for label in candidate["tied_with"])
    assert set(found["remaining_rms"]) == set(bench.robot.joints)

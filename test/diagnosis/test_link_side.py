"""A sensor behind the gear feels neither rotor nor current; what rubs beyond it, it feels and diagnose finds."""

from __future__ import annotations

import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from robot_ident.cli.main import main
from robot_ident.diagnosis.diagnose import diagnose
from robot_ident.effects import CATALOGUE, candidates_of, refuse_unseen
from robot_ident.errors import InputError
from robot_ident.model.structure import Structure
from robot_ident.recording import process
from robot_ident.robot import Robot, load_robot
from robot_ident.robot.drives import Effort, Efforts
from robot_ident.testbed.calibrate import standard_motions
from robot_ident.testbed.phenomena import plant_physics
from robot_ident.testbed.simulation import Play

DRIVE = {"rotor_inertia", "torque_saturation", "wrist_coupling"}
BEYOND = {
    "stribeck",
    "presliding",
    "friction_behind_play",
    "load_friction",
    "position_friction",
    "viscous_nonlinear",
    "viscous_asymmetric",
}


@pytest.fixture(scope="module")
def behind() -> Robot:
    return replace(load_robot(), effort=Efforts(Effort(side="link")))


def test_what_the_sensor_cannot_see_is_no_candidate(behind: Robot) -> None:
    structure = Structure.build(behind)
    offered = {effect.name for effect in candidates_of(structure)}
    assert not offered & DRIVE
    assert {"torque_offset", "base_tilt", "time_delay", "cable", *BEYOND} <= offered
    assert {name for name, kind in CATALOGUE.items() if "link" not in kind.seen_from} == DRIVE
    assert offered == {effect.name for effect in candidates_of(structure) if "link" in CATALOGUE[effect.name].seen_from}
    assert "stribeck@joint_1" in Structure.build(behind, ["stribeck@joint_1"]).labels


@pytest.mark.parametrize("name", sorted(DRIVE))
def test_what_physics_forbids_is_refused_with_its_reason(behind: Robot, name: str) -> None:
    told = re.escape(CATALOGUE[name].before_sensor)
    assert told
    with pytest.raises(InputError, match=f"{name}@joint_2.*measured on the link side: {told}"):
        Structure.build(behind, [f"{name}@joint_2"])
    with pytest.raises(InputError, match=f"{name}@joint_2.*measured on the link side: {told}"):
        refuse_unseen([f"{name}@joint_2"], behind)


def test_identify_refuses_before_it_reads_a_recording(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source = Path(load_robot().source)
    shutil.copy(source.with_suffix(".urdf"), tmp_path)
    robot = tmp_path / "robot.yaml"
    robot.write_text(source.read_text(encoding="utf-8") + "\neffort: {side: link}\n", encoding="utf-8")
    words = ["identify", "not_there.npz", "--robot", str(robot), "--effect", "torque_saturation@joint_2"]
    assert main(words) == 2
    assert "the sensor measures no current" in capsys.readouterr().err


def test_the_paper_s_model_stays_and_no_rotor_is_in_its_links(behind: Robot) -> None:
    plain, structure = Structure.build(load_robot()), Structure.build(behind)
    assert structure.labels == plain.labels
    assert any("rotor" in rule for rule in plain.base.rules)
    assert not any("rotor" in rule for rule in structure.base.rules)
    assert any("measured behind the gear" in note for note in structure.notes)


def test_one_joint_behind_the_gear_keeps_the_others_candidates(behind: Robot) -> None:
    mixed = replace(behind, effort=Efforts(by_joint={"joint_2": Effort(side="link")}))
    offered = {effect.label for effect in candidates_of(Structure.build(mixed))}
    assert "torque_saturation@joint_1" in offered
    assert "torque_saturation@joint_2" not in offered


def test_diagnosis_of_a_simulated_sensor_behind_the_gear(behind: Robot) -> None:
    """Stick-slip on the motor leaves no trace in the torque of the links, an offset of the sensor does."""
    motions = standard_motions(behind)[:2]
    physics = plant_physics(behind, ["stribeck@joint_2:stribeck=20"])
    plays = [Play.of(behind, physics, motion) for motion in motions]
    recordings = [play.record(4, seed=k) for k, play in enumerate(plays)]
    structure = Structure.build(behind)
    found = diagnose([process(one, behind) for one in recordings], structure)
    assert found.verdict == "adequate"
    assert set(found.hidden_from_sensor) == set(behind.joints)
    assert "torque_saturation" in found.to_dict()["hidden_from_sensor"]["joint_2"]
    assert "stribeck" not in found.to_dict()["hidden_from_sensor"]["joint_2"]
    assert sum("behind the gear" in note for note in found.notes) == 1
    moved = [replace(one, tau=one.tau + np.array([0.0, 60.0, 0.0])) for one in recordings]
    found = diagnose([process(one, behind) for one in moved], structure)
    assert found.verdict == "missing"
    assert all("link" in s.effect.seen_from for s in (*found.missing, *found.others))
    assert "torque_offset@joint_2" in [label for s in found.missing for label in (s.label, *s.tied_with)]


def test_diagnosis_finds_a_bearing_that_sticks_beyond_the_sensor(behind: Robot) -> None:
    """A seal whose friction grows at low speed adds to what the sensor feels: f sign(dq) exp(-(dq / vs)^2)."""
    motions = standard_motions(behind)[:2]
    physics = plant_physics(behind, [])
    recordings = []
    for k, motion in enumerate(motions):
        one = Play.of(behind, physics, motion).record(4, seed=k)
        speed = np.gradient(one.q[:, 1], one.t)
        speed = np.convolve(speed, np.ones(9) / 9, mode="same")
        friction = np.zeros_like(one.tau)
        friction[:, 1] = 25.0 * np.sign(speed) * np.exp(-((speed / 0.15) ** 2))
        recordings.append(replace(one, tau=one.tau + friction))
    found = diagnose([process(one, behind) for one in recordings], Structure.build(behind))
    assert found.verdict == "missing"
    assert "stribeck@joint_2" in [label for s in found.missing for label in (s.label, *s.tied_with)]

"""A sensor behind the gear feels neither friction nor rotors: nothing of the kind is ever offered, and it is said."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from robot_ident.diagnosis.diagnose import diagnose
from robot_ident.effects import CATALOGUE, candidates_of
from robot_ident.errors import InputError
from robot_ident.model.structure import Structure
from robot_ident.recording import process
from robot_ident.robot import Robot, load_robot
from robot_ident.robot.effort import Effort, Efforts
from robot_ident.simulation.calibrate import standard_motions
from robot_ident.simulation.periodic import Play
from robot_ident.simulation.physics import plant_physics

DRIVE = {"viscous", "coulomb", "stribeck", "rotor_inertia", "torque_ripple", "load_friction", "temperature_drift"}


@pytest.fixture(scope="module")
def behind() -> Robot:
    return replace(load_robot(), effort=Efforts(Effort(side="link")))


def test_what_the_sensor_cannot_see_is_no_candidate(behind: Robot) -> None:
    structure = Structure.build(behind)
    offered = {effect.name for effect in candidates_of(structure)}
    assert not offered & DRIVE
    assert {"torque_offset", "base_tilt", "time_delay", "cable"} <= offered
    assert offered == {effect.name for effect in candidates_of(structure) if "link" in CATALOGUE[effect.name].seen_from}
    with pytest.raises(InputError, match="stribeck@joint_1.*measured on the link side, where it does not show"):
        Structure.build(behind, ["stribeck@joint_1"])


def test_the_paper_s_model_stays_and_no_rotor_is_in_its_links(behind: Robot) -> None:
    plain, structure = Structure.build(load_robot()), Structure.build(behind)
    assert structure.labels == plain.labels
    assert any("rotor" in rule for rule in plain.base.rules)
    assert not any("rotor" in rule for rule in structure.base.rules)
    assert any("measured behind the gear" in note for note in structure.notes)


def test_one_joint_behind_the_gear_keeps_the_others_candidates(behind: Robot) -> None:
    mixed = replace(behind, effort=Efforts(by_joint={"joint_2": Effort(side="link")}))
    offered = {effect.label for effect in candidates_of(Structure.build(mixed))}
    assert "stribeck@joint_1" in offered
    assert "stribeck@joint_2" not in offered


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
    assert "stribeck" in found.to_dict()["hidden_from_sensor"]["joint_2"]
    assert sum("behind the gear" in note for note in found.notes) == 1
    moved = [replace(one, tau=one.tau + np.array([0.0, 60.0, 0.0])) for one in recordings]
    found = diagnose([process(one, behind) for one in moved], structure)
    assert found.verdict == "missing"
    assert all("link" in s.effect.seen_from for s in (*found.missing, *found.others))
    assert "torque_offset@joint_2" in [label for s in found.missing for label in (s.label, *s.tied_with)]

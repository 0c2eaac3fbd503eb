"""A payload alone, on a known arm, from 30 s of motion: mass, centre and intervals that cover."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from robot_ident.bags import write_recording
from robot_ident.cli.main import main
from robot_ident.design.target import Target, all_but_payload
from robot_ident.errors import InputError
from robot_ident.estimation.identify import identify
from robot_ident.estimation.payload import PayloadFit, identify_payload
from robot_ident.estimation.prediction import predict
from robot_ident.model.model import Model
from robot_ident.model.model_file import write_model
from robot_ident.recording import process
from robot_ident.recording.conditions import Conditions, KnownPayload, read_conditions
from robot_ident.robot import Robot, load_robot
from robot_ident.testbed.calibrate import standard_motions
from robot_ident.testbed.phenomena import plant_physics
from robot_ident.testbed.simulation import Play

MASS, CENTRE = 2.0, np.array([0.03, 0.02, 0.08])
TEXT = "payload:payload=2,x=0.03,y=0.02,z=0.08"
SEEDS = 12


@pytest.fixture(scope="module")
def arm(robots_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Robot:
    """Return a UR10 with rotors, friction and noise of its size."""
    names = [f"{j}_joint" for j in ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")]
    joints = {
        name: {
            "torque_variance": 4.0 if k < 3 else 0.4,
            "position_variance": 1e-9,
            "velocity": 1.5,
            "acceleration": 5.0,
            "armature": 2.0 if k < 3 else 0.2,
        }
        for k, name in enumerate(names)
    }
    friction = {name: 5.0 if k < 3 else 1.0 for k, name in enumerate(names)}
    data = {
        "schema": "robot_ident/robot/1",
        "name": "ur10",
        "urdf": str(robots_folder / "ur_description/urdf/ur10_joint_limited_robot.urdf"),
        "joints": joints,
        "effects": ["rotor_inertia@*"],
        "simulation": {"viscous": dict(friction), "coulomb": dict(friction)},
    }
    path = tmp_path_factory.mktemp("arm") / "ur10.yaml"
    path.write_text(yaml.safe_dump(data, sort_keys=False), encoding="utf-8")
    return load_robot(path)


@pytest.fixture(scope="module")
def plays(arm: Robot) -> tuple[list[Play], Play]:
    """Return the empty arm on two motions, and with 2 kg on the second."""
    motions = standard_motions(arm)[:2]
    empty = [Play.of(arm, plant_physics(arm, []), motion, sample_rate=75.0) for motion in motions]
    return empty, Play.of(arm, plant_physics(arm, [TEXT]), motions[1], sample_rate=75.0)


@pytest.fixture(scope="module")
def model(arm: Robot, plays: tuple[list[Play], Play]) -> Model:
    return identify([play.record(16, seed=k) for k, play in enumerate(plays[0])], arm)


@pytest.fixture(scope="module")
def found(arm: Robot, plays: tuple[list[Play], Play]) -> list[PayloadFit]:
    """Return payloads from three periods of 10 s each, the arm identified anew for every fourth."""
    out = []
    for seed in range(SEEDS):
        if seed % 4 == 0:
            runs = [play.record(16, seed=1000 + 2 * seed + k) for k, play in enumerate(plays[0])]
            known = identify(runs, arm)
        out.append(identify_payload([process(plays[1].record(3, seed=seed), arm)], known))
    return out


@pytest.mark.long
def test_mass_within_two_percent_and_centre_within_5_mm(found: list[PayloadFit]) -> None:
    for fit in found:
        assert abs(fit.body.mass - MASS) < 0.02 * MASS
        assert np.abs(fit.body.centre - CENTRE).max() < 0.005


@pytest.mark.long
def test_intervals_cover(found: list[PayloadFit]) -> None:
    """Of 48 intervals of 95 % at least 41 hold the truth but in one of a thousand cases."""
    bodies = [fit.body for fit in found]
    z = np.array([[(b.mass - MASS) / b.mass_std, *((b.centre - CENTRE) / b.centre_std)] for b in bodies])
    assert np.sum(np.abs(z) < 1.96) >= 41
    assert 0.7 < np.sqrt(np.mean(z**2)) < 1.4


@pytest.mark.long
def test_other_friction_than_the_model_s_does_no_harm(arm: Robot, plays: tuple[list[Play], Play], model: Model) -> None:
    warm = {name: 0.7 * values["viscous"] for name, values in arm.simulation["viscous"].items()}
    simulation = {**arm.simulation, "viscous": {name: {"viscous": value} for name, value in warm.items()}}
    physics = plant_physics(replace(arm, simulation=simulation), [TEXT])
    play = Play.of(arm, physics, standard_motions(arm)[1], sample_rate=75.0)
    fit = identify_payload([process(play.record(3, seed=5), arm)], model)
    assert abs(fit.body.mass - MASS) < 4 * fit.body.mass_std < 0.02 * MASS
    assert np.all(np.abs(fit.body.centre - CENTRE) < 4 * fit.body.centre_std)


def test_a_motion_that_tells_too_little_is_refused(arm: Robot, plays: tuple[list[Play], Play], model: Model) -> None:
    vague = replace(model, covariance=np.eye(len(model.values)) * 1e6)
    with pytest.raises(InputError, match="does not tell mass and centre.*design --only payload"):
        identify_payload([process(plays[1].record(3, seed=1), arm)], vague)


def test_a_design_for_the_payload_alone_knows_the_arm(arm: Robot) -> None:
    target = Target.of_robot(arm)
    prior = all_but_payload(target)
    values = np.linalg.eigvalsh(prior / np.sqrt(np.outer(*(2 * [np.maximum(np.diag(prior), 1e-30)]))))
    rigid = len(target.structure.base.columns)
    own = target.structure.base.regrouping[:, 50:60]
    assert np.abs(prior[:rigid, :rigid] @ own).max() < 1e-6 * np.abs(prior).max(), "a payload changes what is free"
    rotors = [k for k, name in enumerate(target.structure.names) if name.startswith("rotor_inertia")]
    assert np.sum(values > 1e-9) == rigid - np.linalg.matrix_rank(own) + len(rotors)
    friction = [k for k in range(rigid, len(prior)) if k not in rotors]
    assert not prior[friction].any(), "friction is free"


def test_the_command_line(
    arm: Robot, plays: tuple[list[Play], Play], model: Model, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag, file, out = tmp_path / "carried.npz", tmp_path / "model.yaml", tmp_path / "next.npz.conditions.yaml"
    write_recording(bag, plays[1].record(3, seed=3))
    write_model(model, file)
    Path(f"{bag}.conditions.yaml").write_text(Conditions(estimated=True).text(), encoding="utf-8")
    words = ["identify", str(bag), "--only", "payload"]
    assert main(words) == 2
    assert "--model model.yaml is needed" in capsys.readouterr().err
    assert main(["identify", str(bag), "--model", str(file)]) == 2
    assert "goes with --only payload" in capsys.readouterr().err
    assert main([*words, "--model", str(file), "--physical"]) == 2
    assert "does not go with --physical" in capsys.readouterr().err
    assert main(["identify", str(bag), "--robot", arm.source]) == 2
    assert "an unknown payload is not told from the last link" in capsys.readouterr().err
    assert main([*words, "--model", str(file), "-o", str(out), "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert data["mass_interval"][0] < data["mass"] < data["mass_interval"][1]
    assert data["mass"] == pytest.approx(MASS, rel=0.02)
    assert set(data["residual_rms"]) == set(arm.joints)
    told = read_conditions(tmp_path / "next.npz").payload
    assert told is not None
    assert told.mass == data["mass"]


def test_an_empty_hand_is_written_as_one(
    arm: Robot,
    plays: tuple[list[Play], Play],
    model: Model,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    bag, file, out = tmp_path / "empty.npz", tmp_path / "model.yaml", tmp_path / "empty.npz.conditions.yaml"
    write_recording(bag, plays[0][1].record(16, seed=77))
    write_model(model, file)
    assert main(["identify", str(bag), "--only", "payload", "--model", str(file), "-o", str(out)]) == 0
    told = capsys.readouterr()
    assert "nothing in the hand that the data tell (" in told.err
    assert read_conditions(bag).payload is None
    assert "nothing in the hand" in read_conditions(bag).note
    copy = tmp_path / "copy.npz"
    write_recording(copy, plays[0][1].record(16, seed=77))
    assert main(["identify", str(bag), str(copy), "--only", "payload", "--model", str(file)]) == 2
    assert f"{copy} holds the samples of {bag}" in capsys.readouterr().err


def test_predictions_carry_what_the_conditions_state(model: Model, plays: tuple[list[Play], Play]) -> None:
    stated = KnownPayload(MASS, (0.03, 0.02, 0.08))
    run = plays[1].record(2, seed=9)
    with_it = predict(model, replace(run, conditions=Conditions(stated)))
    without = predict(model, run)
    middle = slice(200, -200)
    error, forgotten = (np.std(run.tau[middle] - one.torque[middle], axis=0) for one in (with_it, without))
    assert np.all(error[1:3] < 2.5)
    assert np.all(forgotten[1:3] > 1.5 * error[1:3])

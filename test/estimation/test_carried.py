"""A payload of which nothing is known, found together with the arm from recordings with and without it."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from robot_ident.bags import write_recording
from robot_ident.cli.identify import payload_tables
from robot_ident.cli.main import main
from robot_ident.effects import make_effect
from robot_ident.errors import InputError
from robot_ident.estimation.identify import extend, identify
from robot_ident.estimation.payload import solve_carrying
from robot_ident.estimation.prediction import measured_for, predict
from robot_ident.estimation.problem import Problem
from robot_ident.estimation.validation import validate
from robot_ident.model.model import Model
from robot_ident.model.model_file import read_model, write_model
from robot_ident.model.structure import Structure
from robot_ident.recording import Recording, process
from robot_ident.recording.conditions import Conditions, KnownPayload, payload_columns
from robot_ident.robot import Robot, load_robot
from robot_ident.robot.locked_joints import hold
from robot_ident.signals.motion import Array
from robot_ident.testbed.calibrate import standard_motions
from robot_ident.testbed.phenomena import plant_physics
from robot_ident.testbed.simulation import Play

BODY = KnownPayload(12.0, (0.06, 0.02, 0.1))
TEXT = "payload:payload=12,x=0.06,y=0.02,z=0.1"
UNKNOWN = Conditions(estimated=True, body="box")
SEEDS = 16


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot()


@pytest.fixture(scope="module")
def plays(robot: Robot) -> tuple[Play, Play]:
    """Return the empty arm on one motion, and the loaded one on another."""
    first, second = standard_motions(robot)[:2]
    empty, loaded = plant_physics(robot, []), plant_physics(robot, [TEXT])
    return Play.of(robot, empty, first, sample_rate=75.0), Play.of(robot, loaded, second, sample_rate=75.0)


def runs_of(plays: tuple[Play, Play], seed: int) -> list[Recording]:
    empty, loaded = plays
    carried = replace(loaded.record(8, seed=2 * seed + 1), source="carried", conditions=UNKNOWN)
    return [replace(empty.record(8, seed=2 * seed), source="plain"), carried]


@pytest.fixture(scope="module")
def runs(plays: tuple[Play, Play]) -> list[Recording]:
    return runs_of(plays, 500)


@pytest.fixture(scope="module")
def model(robot: Robot, runs: list[Recording]) -> Model:
    return identify(runs, robot)


def test_arm_and_payload_are_one_least_squares_problem(robot: Robot, runs: list[Recording], model: Model) -> None:
    """Against the stacked system, solved by its normal equations: the same arm, and the same standard deviations."""
    structure = Structure.build(robot)
    measured = [process(run, robot) for run in runs]
    problem = Problem(measured, structure)
    equations = problem.equations(structure, None)
    problem = problem.beside(model.linear, replace(equations, torque=equations.phi @ model.linear)) or problem
    loads = np.zeros((equations.rows, 10))
    rows = equations.block == 1
    whole = measured[1].passed(payload_columns(robot, measured[1].motion))
    loads[rows] = whole[equations.sample[rows], equations.joint[rows]]
    u, size, _ = np.linalg.svd(loads, full_matrices=False)
    jacobian = np.hstack([equations.phi, u[:, size > 1e-9 * size[0]]])
    weight = np.sqrt(problem.noise.independent)[:, None]
    white = problem.noise.whiten(jacobian) * weight
    right = problem.noise.whiten(equations.torque) * weight[:, 0]
    information = white.T @ white
    values = np.linalg.solve(information, white.T @ right)
    std = np.sqrt(np.diag(np.linalg.inv(information)))
    p = len(model.linear)
    assert np.all(np.abs(values[:p] - model.linear) < 0.02 * std[:p])
    np.testing.assert_allclose(model.std, std[:p], rtol=0.02)


@pytest.mark.long
def test_intervals_cover_arm_and_payload(robot: Robot, plays: tuple[Play, Play]) -> None:
    truth = Structure.build(robot).true_values()
    arm: list[Array] = []
    body: list[Array] = []
    for seed in range(SEEDS):
        found = identify(runs_of(plays, seed), robot)
        (one,) = found.payloads
        arm.append((found.linear - truth) / found.std)
        off = [one["mass"] - BODY.mass, *(np.array(one["centre"]) - BODY.centre)]
        body.append(np.array(off) / [one["mass_std"], *one["centre_std"]])
        assert abs(off[0]) < 0.05 * BODY.mass
    z = np.concatenate([np.ravel(arm), np.ravel(body)])
    assert 0.8 < np.sqrt(np.mean(np.square(arm))) < 1.2
    assert 0.6 < np.sqrt(np.mean(np.square(body))) < 1.5
    assert np.mean(np.abs(z) < 1.96) > 0.9


def test_the_model_is_that_of_the_arm_alone(plays: tuple[Play, Play], model: Model, runs: list[Recording]) -> None:
    """Taken as empty the loaded recording would make the arm another; with its payload found it tells it better."""
    plain = identify(runs[:1], model.robot)
    wrong = identify([runs[0], replace(runs[1], conditions=Conditions())], model.robot)
    unseen = plays[0].record(4, seed=77)
    own, alone, confused = (
        [validate(m, unseen).residual[j].rms for j in model.robot.joints] for m in (model, plain, wrong)
    )
    assert np.all(np.array(own) < 1.05 * np.array(alone))
    assert max(np.array(confused) / own) > 1.5
    assert np.all(model.std < 1.001 * plain.std)
    assert any(note.startswith("payload box of carried: 1") for note in model.notes)


def test_what_the_motion_does_not_tell_is_said(robot: Robot) -> None:
    """In a plane nothing shows where the body lies across it; what does show is told all the same, and the arm."""
    planar = hold(robot, ["joint_2", "joint_3"], {"joint_1": 0.0})
    plays = [
        Play.of(planar, plant_physics(planar, effects), motion, sample_rate=75.0)
        for effects, motion in zip(([], [TEXT]), standard_motions(planar), strict=False)
    ]
    found = identify(runs_of((plays[0], plays[1]), 5), planar)
    (one,) = found.payloads
    told = {p["name"]: p["told"] for p in one["parameters"]}
    assert [name for name, known in told.items() if known] == ["m", "mx", "my", "Izz"]
    assert abs(one["mass"] - BODY.mass) < 3 * one["mass_std"] < 0.1 * BODY.mass
    assert any(note.endswith("the motion does not tell mz, Ixx, Ixy, Iyy, Ixz, Iyz") for note in found.notes)
    assert ", ?] m" in " ".join(found.notes)
    assert "not told" in payload_tables(found)[0]
    error = (found.linear - found.structure.true_values()) / found.std
    assert np.abs(error).max() < 4.0


def test_recordings_of_one_name_share_the_payload(
    robot: Robot, plays: tuple[Play, Play], runs: list[Recording]
) -> None:
    again = replace(plays[1].record(8, seed=41), source="again", conditions=UNKNOWN)
    other = replace(again, conditions=Conditions(estimated=True, body="other"))
    (shared,) = identify([*runs, again], robot).payloads
    apart = identify([*runs, other], robot).payloads
    assert shared["recordings"] == ["carried", "again"]
    assert [one["name"] for one in apart] == ["box", "other"]
    assert shared["mass_std"] < 0.95 * apart[0]["mass_std"]


def test_what_can_not_be_told_is_refused(robot: Robot, plays: tuple[Play, Play], runs: list[Recording]) -> None:
    other = replace(plays[0].record(8, seed=3), conditions=Conditions(estimated=True, body="other"))
    for carried in ([runs[1]], [runs[1], other]):
        with pytest.raises(InputError, match="an unknown payload is not told from the last link"):
            identify(carried, robot)


def test_a_known_payload_beside_it_tells_it_as_well(
    robot: Robot, plays: tuple[Play, Play], runs: list[Recording]
) -> None:
    known = replace(plays[1].record(8, seed=9), source="known", conditions=Conditions(BODY))
    (one,) = identify([known, runs[1]], robot).payloads
    assert abs(one["mass"] - BODY.mass) < 4 * one["mass_std"]


def test_later_verbs_take_off_what_was_found(model: Model, runs: list[Recording], plays: tuple[Play, Play]) -> None:
    """By its name from the model, and what one recording alone tells where the model does not know it."""
    noise = np.sqrt([v or 0.0 for v in model.noise.torque_variance])
    fresh = replace(plays[1].record(4, seed=90), source="fresh", conditions=UNKNOWN)
    stranger = replace(fresh, conditions=Conditions(estimated=True))
    for run in (fresh, stranger):
        measured = measured_for(model, run)
        assert measured.conditions.payload is not None
        assert measured.conditions.payload.mass == pytest.approx(BODY.mass, rel=0.05)
        rest = measured.torque - model.predict(measured.motion)
        assert np.all(np.std(rest, axis=0) < noise)
    assert any("payload found by this recording" in note for note in measured.notes)
    rms = np.array([fit.rms for fit in validate(model, fresh).residual.values()])
    bare = np.array([fit.rms for fit in validate(model, replace(fresh, conditions=Conditions())).residual.values()])
    assert bare[1] > 2.0 * rms[1]
    lighter = predict(model, stranger).torque - predict(model, fresh).torque
    assert np.std(lighter[:, 1]) > 5.0


def test_an_effect_added_finds_the_payload_anew(model: Model, runs: list[Recording]) -> None:
    measured = [measured_for(model, run) for run in runs]
    before, after = extend(model, measured, [make_effect("stribeck@joint_2", model.robot)])
    assert before.payloads[0]["mass"] == pytest.approx(model.payloads[0]["mass"], rel=1e-4)
    assert after.payloads[0]["mass"] == pytest.approx(BODY.mass, rel=0.05)
    solved = solve_carrying(measured, after.structure, "wls")
    assert len(solved.measurements) == 2
    assert solved.payloads[0].body.mass == pytest.approx(after.payloads[0]["mass"], rel=1e-3)


def test_the_command_line(
    robot: Robot, runs: list[Recording], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plain, carried, file = tmp_path / "plain.npz", tmp_path / "carried.npz", tmp_path / "model.yaml"
    write_recording(plain, runs[0])
    write_recording(carried, runs[1])
    Path(f"{carried}.conditions.yaml").write_text(UNKNOWN.text(), encoding="utf-8")
    assert main(["info", str(carried), "--robot", robot.name, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["declaration"] == [], "an unknown payload would seem a wrong gain"
    assert any("payload is unknown" in note for note in told["notes"])
    assert main(["identify", str(plain), str(carried), "-o", str(file)]) == 0
    out = capsys.readouterr().out
    assert "payload box" in out
    assert "centre z" in out
    model = read_model(file)
    assert model.payloads[0]["mass"] == pytest.approx(BODY.mass, rel=0.05)
    write_model(model, tmp_path / "again.yaml")
    assert read_model(tmp_path / "again.yaml").payloads == model.payloads
    assert main(["compare", str(file), str(carried), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["schema"].startswith("robot_ident/comparison")
    assert main(["validate", str(file), str(carried), "--json"]) == 0
    fits = json.loads(capsys.readouterr().out)["residual"]
    assert all(one["rms"] ** 2 < 3.0 * (one["noise_variance"] or 0.0) for one in fits.values())

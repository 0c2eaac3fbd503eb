"""Drive gains from recordings with and without a known payload; without one everything carries the ampere."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from robot_ident.bags import write_recording
from robot_ident.cli.main import main
from robot_ident.diagnosis.diagnose import diagnose
from robot_ident.errors import InputError
from robot_ident.estimation.drive_gains import Gains, estimate_gains
from robot_ident.estimation.effort_checks import taken_as_declared
from robot_ident.estimation.identify import extended_with_gains, identify, tells_gains
from robot_ident.estimation.prediction import predict
from robot_ident.model.model import Model
from robot_ident.model.model_file import read_model, write_model
from robot_ident.model.structure import Structure
from robot_ident.recording import Processing, Recording, process
from robot_ident.recording.conditions import Conditions, KnownPayload, PayloadPart
from robot_ident.robot import Robot, load_robot
from robot_ident.robot.drives import Effort, Efforts
from robot_ident.robot.robot_file import definition_of
from robot_ident.testbed.calibrate import standard_motions
from robot_ident.testbed.phenomena import plant_physics
from robot_ident.testbed.simulation import Play

URDF = "ur_description/urdf/ur5_joint_limited_robot.urdf"
JOINTS = [f"{j}_joint" for j in ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")]
GAINS = np.array([0.115, 0.12, 0.11, 0.085, 0.09, 0.08])  # Nm/A on the motor's shaft
PAYLOAD = KnownPayload(5.0, (0.03, 0.05, 0.08))


def write(folder: Path, robots: Path, *, known: bool) -> Path:
    """Write a six-axis arm that reports motor currents, with or without its drives' gains."""
    joints = {}
    for k, joint in enumerate(JOINTS):
        joints[joint] = {"gear_ratio": 101.0, "torque_variance": 4.0 if k < 3 else 0.4, "position_variance": 1e-9}
        joints[joint] |= {"velocity": 1.5, "acceleration": 5.0}
        joints[joint] |= {"torque_constant": float(GAINS[k])} if known else {}
    friction = {joint: 3.0 if k < 3 else 0.8 for k, joint in enumerate(JOINTS)}
    data = {
        "schema": "robot_ident/robot/1",
        "name": "ur5",
        "urdf": str(robots / URDF),
        "effort": {"quantity": "current", "side": "motor"},
        "joints": joints,
        "simulation": {"viscous": dict(friction), "coulomb": dict(friction)},
    }
    path = folder / f"{'known' if known else 'unknown'}.yaml"
    path.write_text(yaml.safe_dump(data, sort_keys=False), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def robots(tmp_path_factory: pytest.TempPathFactory, robots_folder: Path) -> tuple[Robot, Robot]:
    folder = tmp_path_factory.mktemp("robots")
    made = (load_robot(write(folder, robots_folder, known=known)) for known in (True, False))
    # what gains do to the same parameters is compared here
    return tuple(replace(robot, base="declared") for robot in made)  # type: ignore[return-value]


@pytest.fixture(scope="module")
def plays(robots: tuple[Robot, Robot]) -> list[Play]:
    """Return the arm without and with a payload of 5 kg."""
    truth, effects = robots[0], ([], ["payload:payload=5,x=0.03,y=0.05,z=0.08"])
    motion = standard_motions(truth)[0]
    return [Play.of(truth, plant_physics(truth, one), motion, sample_rate=100.0) for one in effects]


@pytest.fixture(scope="module")
def recordings(plays: list[Play]) -> tuple[Recording, Recording]:
    """One recording without and one with a payload of 5 kg, in ampere."""
    return plays[0].record(16, seed=0), replace(plays[1].record(16, seed=1), conditions=Conditions(PAYLOAD))


@pytest.fixture(scope="module")
def repeated(plays: list[Play]) -> tuple[Recording, Recording]:
    """The same once more."""
    return plays[0].record(16, seed=2), replace(plays[1].record(16, seed=3), conditions=Conditions(PAYLOAD))


@pytest.fixture(scope="module")
def model(robots: tuple[Robot, Robot], recordings: tuple[Recording, Recording]) -> Model:
    return identify(recordings, robots[1])


@pytest.fixture(scope="module")
def bare(robots: tuple[Robot, Robot], recordings: tuple[Recording, Recording]) -> Model:
    return identify(recordings[:1], robots[1])


def test_gains_of_all_loaded_joints_within_two_percent(model: Model) -> None:
    assert model.gains is not None
    value, std = (np.array([one[key] for one in model.gains]) for key in ("value", "std"))
    assert [one["loaded"] for one in model.gains] == [True] * 6
    assert {one["unit"] for one in model.gains} == {"Nm/A"}
    np.testing.assert_allclose(value, GAINS, rtol=0.02)
    assert np.all(np.abs(value - GAINS) < 4 * std)
    assert np.all(std < 0.01 * value)


@pytest.mark.long
def test_the_arm_s_parameters_are_absolute_and_count_the_gains_uncertainty(
    model: Model, recordings: tuple[Recording, Recording], repeated: tuple[Recording, Recording]
) -> None:
    truth = model.structure.true_values()
    error = (model.values - truth) / model.std
    assert np.abs(error).max() < 5.0
    assert np.sqrt(np.mean(error**2)) < 1.6
    assert {p.unit for p in model.parameters} == {"kg m^2", "kg m", "Nm s/rad", "Nm"}
    free = identify([recordings[0], repeated[0]], model.robot)
    largest = int(np.argmax(np.abs(truth)))
    assert model.std[largest] > 1.2 * free.std[largest], "gains known for sure make sigmas smaller"


def test_a_model_file_keeps_gains_and_takes_currents(
    model: Model, recordings: tuple[Recording, Recording], tmp_path: Path
) -> None:
    write_model(model, tmp_path / "model.yaml")
    again = read_model(tmp_path / "model.yaml")
    assert again.gains == model.gains
    assert again.robot.ampere_joints == ()
    for recording in recordings:
        measured = process(recording, again.robot, Processing(**dict(again.processing)))
        residual = (measured.torque - again.predict(measured.motion))[measured.used.all(axis=1)]
        usual = np.array([fit.rms for fit in model.residual.values()])
        np.testing.assert_allclose(np.sqrt(np.mean(residual**2, axis=0)), usual, rtol=0.3)


def test_gains_are_found_anew_with_what_was_missing(
    robots: tuple[Robot, Robot], recordings: tuple[Recording, Recording]
) -> None:
    """A hose that the model lacks: its share of the torque went into gain and friction, and comes out of them again."""
    hose = np.array([15.0 / (101.0 * GAINS[0]), 0.0, 0.0, 0.0, 0.0, 0.0])  # A/rad
    recordings = tuple(replace(r, tau=r.tau + hose * (r.q - 0.3)) for r in recordings)  # type: ignore[assignment]
    lacking = identify(recordings, robots[1])
    measured = [process(r, lacking.robot, Processing(**dict(lacking.processing))) for r in recordings]
    assert tells_gains(lacking, measured)
    assert not tells_gains(lacking, measured[:1])
    made = extended_with_gains(lacking, recordings, ["cable@shoulder_pan_joint"])
    assert made.structure.labels[-1] == "cable@shoulder_pan_joint"
    assert made.provenance["added"] == ["cable@shoulder_pan_joint"]
    accepted = replace(lacking, notes=("shoulder_pan_joint: another unit; taken as declared",))
    assert taken_as_declared(extended_with_gains(accepted, recordings, []).notes)
    before, after = ({one["joint"]: one for one in m.gains or ()}["shoulder_pan_joint"] for m in (lacking, made))
    assert abs(before["value"] - GAINS[0]) > 10 * after["std"], "or nothing would show here"
    assert abs(after["value"] - GAINS[0]) < 4 * after["std"]
    stiffness = [p.name for p in made.parameters].index("cable.stiffness@shoulder_pan_joint")
    assert abs(made.values[stiffness] - 15.0) < 4 * made.std[stiffness]
    assert made.std[stiffness] / 15.0 > 0.9 * after["std"] / GAINS[0], "the gain's uncertainty is the stiffness's"


def test_without_a_payload_everything_carries_the_ampere(bare: Model) -> None:
    assert bare.gains is not None
    assert {one["unit"] for one in bare.gains} == {"A/A"}
    assert bare.robot.ampere_joints == tuple(JOINTS)
    assert {p.unit for p in bare.parameters} == {"A s^2/rad", "A s^2/m", "A s/rad", "A"}
    assert any("results carry the unit A" in note for note in bare.notes)
    ratio, std = (np.array([one[key] for one in bare.gains]) for key in ("value", "std"))
    told = std[1:] < 0.3 * ratio[1:]
    assert told.sum() >= 3
    assert np.all(np.abs(ratio[1:] - GAINS[1:] / GAINS[0])[told] < 4 * std[1:][told])


def test_a_prediction_carries_the_amperes_that_each_drive_reports(
    bare: Model, repeated: tuple[Recording, Recording]
) -> None:
    found, reported = predict(bare, repeated[0]), repeated[0].tau
    assert found.units == ("A",) * 6
    measured = np.column_stack([np.interp(found.t, repeated[0].t, tau) for tau in reported.T])
    slope = np.sum(found.torque * measured, axis=0) / np.sum(found.torque**2, axis=0)
    assert np.all(np.abs(slope - 1.0) < 0.05), "amperes of the first drive would be off by up to 44 %"


def test_diagnosis_works_in_ampere(tmp_path: Path) -> None:
    """The KUKA's drives as they report, what hides in them named, its size in A."""
    truth = load_robot()
    definition = definition_of(truth)
    data = {**definition.yaml, "name": "bare", "urdf": "bare.urdf", "effort": "current"}
    data["joints"] = {
        name: {key: value for key, value in record.items() if key != "torque_constant"}
        for name, record in data["joints"].items()
    }
    (tmp_path / "bare.urdf").write_text(definition.urdf, encoding="utf-8")
    (tmp_path / "bare.yaml").write_text(yaml.safe_dump(data, sort_keys=False), encoding="utf-8")
    runs = []
    for number, motion in enumerate(standard_motions(truth)[:2]):
        run = Play.of(truth, plant_physics(truth, ["stribeck@joint_2:stribeck=25"]), motion).record(6, seed=number)
        runs.append(replace(run, tau=run.tau / truth.drives.torque_constant))
    fitted = identify(runs, load_robot(tmp_path / "bare.yaml"))
    assert fitted.robot.ampere_joints == truth.joints
    assert {fitted.robot.torque_unit(joint) for joint in range(3)} == {"A"}
    found = diagnose([process(run, fitted.robot) for run in runs], fitted.structure)
    assert found.verdict == "missing"
    assert found.missing[0].label == "stribeck@joint_2"
    assert found.missing[0].parameters[0].unit == "A"


def test_what_needs_newton_metres_is_refused(
    bare: Model,
    robots: tuple[Robot, Robot],
    recordings: tuple[Recording, Recording],
    repeated: tuple[Recording, Recording],
    tmp_path: Path,
) -> None:
    write_model(bare, tmp_path / "model.yaml")
    assert main(["export", str(tmp_path / "model.yaml"), "--urdf", str(tmp_path / "out.urdf")]) == 2
    assert not (tmp_path / "out.urdf").exists()
    with pytest.raises(InputError, match="no inertia is known in kg m"):
        identify(recordings[:1], robots[1], physical=True)
    same = [recordings[1], repeated[1]]
    with pytest.raises(InputError, match="the same payload; drive gains need one without it"):
        identify(same, robots[1])


def test_a_weighed_payload_tells_the_gains_and_is_found_with_them(
    robots: tuple[Robot, Robot], recordings: tuple[Recording, Recording], model: Model
) -> None:
    weighed = Conditions(estimated=True, body="box", part=PayloadPart(mass=PAYLOAD.mass))
    found = identify([recordings[0], replace(recordings[1], conditions=weighed)], robots[1])
    assert found.gains is not None and model.gains is not None
    value, std = (np.array([one[key] for one in found.gains]) for key in ("value", "std"))
    np.testing.assert_allclose(value, GAINS, rtol=0.02)
    assert np.all(np.abs(value - GAINS) < 4 * std)
    assert np.all(std > 0.999 * np.array([one["std"] for one in model.gains])), "less is known, no more is told"
    load = np.array([[one["payload_rms"] for one in m.gains or ()] for m in (found, model)])
    np.testing.assert_allclose(load[0], load[1], rtol=0.05)
    (box,) = found.payloads
    assert box["mass"] == PAYLOAD.mass and box["given"] == ["mass"]
    off = np.array(box["centre"]) - PAYLOAD.centre
    assert np.all(np.abs(off) < 4 * np.array(box["centre_std"])) and np.abs(off).max() < 0.005
    assert np.abs((found.values - found.structure.true_values()) / found.std).max() < 5.0
    known = identify([recordings[0], replace(recordings[1], conditions=weighed)], robots[0])
    surer = np.array(known.payloads[0]["centre_std"]) / box["centre_std"]
    assert np.all(surer < 1.0), "what the gains leave open, the centre has too"


@pytest.mark.long
def test_gains_and_payload_both_unknown_are_told_in_one_line(
    robots: tuple[Robot, Robot], recordings: tuple[Recording, Recording], repeated: tuple[Recording, Recording]
) -> None:
    unknown = Conditions(estimated=True, body="box", part=PayloadPart(centre=PAYLOAD.centre))
    with pytest.raises(InputError, match="data tell their product alone: weigh it") as caught:
        identify([recordings[0], replace(recordings[1], conditions=unknown)], robots[1])
    assert "{estimate: box, mass: KG}" in str(caught.value) and "\n" not in str(caught.value)
    # one more recording, of a body that is known, sets the scale for both
    again = replace(repeated[1], source="again", conditions=Conditions(estimated=True, body="box"))
    found = identify([*recordings, again], robots[1])
    (box,) = found.payloads
    assert abs(box["mass"] - PAYLOAD.mass) < 4 * box["mass_std"] < 0.1 * PAYLOAD.mass
    whole = [process(r, found.robot, Processing(**dict(found.processing))) for r in (*recordings, again)]
    assert tells_gains(found, whole)
    assert not tells_gains(found, [whole[0], whole[2]]), "without the known one nothing sets the scale"


@pytest.mark.long
def test_the_command_line_takes_the_payload_from_the_sidecar(
    robots: tuple[Robot, Robot],
    recordings: tuple[Recording, Recording],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    bags = [tmp_path / "plain.npz", tmp_path / "loaded.npz"]
    for bag, recording in zip(bags, recordings, strict=True):
        write_recording(bag, recording)
    (tmp_path / "loaded.npz.conditions.yaml").write_text(Conditions(PAYLOAD).text(), encoding="utf-8")
    assert main(["identify", *map(str, bags), "--robot", robots[1].source]) == 0
    captured = capsys.readouterr()
    assert "drive gains by the payload, Nm/A: shoulder_pan_joint 0.11" in captured.err
    assert "kg m^2" in captured.out


@pytest.mark.long
def test_a_drive_that_nothing_tells_of_does_not_harm_the_others(
    robots: tuple[Robot, Robot], recordings: tuple[Recording, Recording]
) -> None:
    """A payload on the last axis loads five joints; what the sixth needs beside friction drowns in noise."""
    truth = robots[0]
    play = Play.of(
        truth, plant_physics(truth, ["payload:payload=5,x=0,y=0,z=0"]), standard_motions(truth)[0], sample_rate=100.0
    )
    loaded = replace(play.record(16, seed=1), conditions=Conditions(KnownPayload(5.0)))
    noise = np.random.default_rng(3)
    runs = []
    for run in (recordings[0], loaded):
        tau = np.array(run.tau)
        tau[:, 5] += 0.5 * np.std(tau[:, 5]) * noise.standard_normal(len(tau))
        runs.append(replace(run, tau=tau))
    found = identify(runs, robots[1])
    assert found.gains is not None
    assert found.robot.ampere_joints == (JOINTS[5],)
    assert [one["unit"] for one in found.gains] == ["Nm/A"] * 5 + ["A/A"]
    np.testing.assert_allclose([one["value"] for one in found.gains[:5]], GAINS[:5], rtol=0.02)
    told = [one["value"] for one in found.gains[:5]]
    assert min(told) < found.gains[5]["value"] < max(told), "like the others, where nothing tells"
    assert any(f"the gain of {JOINTS[5]} stays unknown" in note for note in found.notes)
    for joint, fit in found.residual.items():
        assert fit.noise_variance is not None
        assert fit.mse < 1.5 * fit.noise_variance, joint
    rigid = [k for k, p in enumerate(found.parameters) if p.effect == "rigid_body"]
    assert {found.parameters[k].unit for k in rigid} == {"kg m^2", "kg m"}
    error = (found.values - found.structure.true_values())[rigid] / found.std[rigid]
    assert np.abs(error).max() < 5.0


def test_a_payload_stated_beside_the_wrong_recording(arm: Any) -> None:
    """No gain is invented, and the exchange that would tell them is named."""
    load = KnownPayload(30.0, (0.0, 0.1, 0.2))
    constant = np.array([20.0, 25.0, 15.0])
    bare, other = (arm.record(seed, periods=4, noise=0.2) for seed in (1, 2))
    carried = load.torque(arm.robot, arm.series.motion(other.t - other.t[0] - 7.3))
    first = replace(bare, tau=bare.tau / constant, source="bare")
    second = replace(other, tau=(other.tau + carried) / constant, source="loaded")
    drives = replace(arm.robot.drives, torque_constant=np.full(3, np.nan))
    robot = replace(arm.robot, effort=Efforts(Effort("current")), drives=drives)
    stated = Conditions(load)
    structure = Structure.build(robot)

    def gains(*recordings: Recording) -> Gains:
        return estimate_gains([process(one, robot, Processing(periodic=True)) for one in recordings], structure)

    right = gains(first, replace(second, conditions=stated))
    assert "joint_2" not in right.unknown
    assert right.values[1] == pytest.approx(25.0, abs=5.0 * right.std[1])
    wrong = gains(replace(first, conditions=stated), second)
    assert wrong.exchanged == "bare and loaded"
    assert wrong.notes[0].startswith("the payloads that the conditions state tell no drive gain")
    assert "exchanged between bare and loaded they would" in wrong.notes[0]
    assert "+-" not in wrong.notes[0]

"""`design --joints`, `--from`, `--waypoints`, `--precision`, and what identifies their recordings."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from production_line import production

from robot_ident.bags import read_recording, write_recording
from robot_ident.trajectories.excitation import Excitation
from robot_ident.trajectories.point_to_point import load_motion

Run = Callable[..., Any]
DESIGN = ("design", "--starts", "1", "--seed", "1", "--time-limit", "6")

WAYPOINTS = """\
schema: robot_ident/waypoints/1
joints: [joint_1, joint_2, joint_3]
poses: {home: [0, 0.2, -0.3], pick: [1.0, 0.6, -0.8], place: [-0.9, -0.4, 0.7], high: [0.0, 0.9, 0.5]}
"""


def test_some_joints_from_design_to_model(run: Run, tmp_path: Path) -> None:
    file, bag = tmp_path / "two.yaml", tmp_path / "two.npz"
    made = run(*DESIGN, "--joints", "joint_3,joint_2", "--hold", "joint_1=0.4", "-o", file, "--json").json
    assert made["held"] == {"joint_1": 0.4}
    assert not any("joint_1" in name for name in made["sigma"])
    excitation = Excitation.read(file)
    assert excitation.joints == ("joint_1", "joint_2", "joint_3")
    np.testing.assert_array_equal(excitation.samples().q[:, 0], 0.4)
    assert run("check", file).code == 0
    assert run("simulate", file, "--periods", "4", "-o", bag).code == 0

    alone = run("identify", bag)
    assert alone.code == 2
    assert "--joints joint_2,joint_3" in alone.err
    model = tmp_path / "model.yaml"
    words = ("identify", bag, "--trajectory", file, "--joints", "joint_2,joint_3", "-o", model, "--json")
    found = run(*words).json
    assert {one["joint"] for one in found["parameters"]} == {"joint_2", "joint_3"}
    assert any("held: joint_1 at 0.4" in note for note in found["notes"])
    truth = {"viscous@joint_2": 33.48, "coulomb@joint_3": 14.51}  # of the simulated robot
    for one in found["parameters"]:
        if one["name"] in truth:
            assert abs(one["value"] - truth[one["name"]]) < 4.0 * one["std"]
    assert run("validate", model, bag).code == 0
    planned = run("predict", model, file, "-o", tmp_path / "planned.csv", "--json").json
    assert set(planned["joints"]) == {"joint_2", "joint_3"}
    assert not any("identified" in note for note in planned["notes"])
    assert run("diagnose", model, bag, "--json").json["verdict"] == "adequate"
    refuses_other_poses(run, model, file, bag, tmp_path)
    again = run("design", "--robot", "kuka_ir361", "--model", model, "-o", tmp_path / "again.yaml")
    assert "say so: --joints joint_2,joint_3" in again.err


def refuses_other_poses(run: Run, model: Path, file: Path, bag: Path, folder: Path) -> None:
    """A model says nothing of the arm where joints that it holds stand elsewhere, or move."""
    recording, elsewhere, moving = read_recording(bag), folder / "elsewhere.npz", folder / "moving.npz"
    write_recording(elsewhere, replace(recording, q=recording.q - np.array([0.5, 0.0, 0.0])))
    swing = np.sin(2.0 * np.pi * 0.25 * recording.t)[:, None] * np.array([1.0, 0.0, 0.0])
    write_recording(moving, replace(recording, q=recording.q + swing))
    pose = "joint_1 stands at -0.1, the model holds it at 0.4; its parameters depend on the pose"
    for other, told in ((elsewhere, pose), (moving, "joint_1 is to be held but moves by 2; take a model in which it")):
        for words in (
            ("compare", model, other),
            ("diagnose", model, bag, "--validation", other),
            ("validate", model, other),
            ("add", model, "stribeck@joint_2", "--bag", other, "-o", folder / "more.yaml"),
            ("predict", model, other, "-o", folder / "more.csv"),
        ):
            ended = run(*words)
            assert ended.code == 2
            assert told in ended.err
    planned = yaml.safe_load(file.read_text())
    planned["q0"][0] = -0.1
    (folder / "other.yaml").write_text(yaml.safe_dump(planned))
    ended = run("predict", model, folder / "other.yaml", "-o", folder / "more.csv")
    assert (ended.code, pose in ended.err) == (2, True)
    ended = run("add", model, "stribeck@joint_1", "--bag", bag)
    assert "joint 'joint_1' is held here, at 0.4" in ended.err


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("--hold", "joint_1=0.4"), "--hold goes with --joints"),
        (("--joints", ""), "argument --joints: the word given is empty; give a name or a value, or leave it out"),
        (("--joints", " ,"), "names no joint"),
        (("--joints", "joint_2", "--hold", "joint_2=0.4"), "--joints moves it"),
        (("--joints", "joint_2", "--hold", "joint_1"), "JOINT=ANGLE was expected"),
        (("--joints", "joint_2", "--hold", "joint_1=9"), "outside of its limits"),
        (("--joints", "joint_9"), "no joint 'joint_9'"),
        (("--precision", "fast"), "a ratio of the value was expected"),
        (("--precision", "5%", "--parameter", "p99"), "--parameter 'p99'"),
        (("--parameter", "p9"), "--parameter goes with --precision"),
    ],
)
def test_options_that_can_not_be_used_are_one_line(run: Run, words: tuple[str, ...], told: str) -> None:
    ended = run(*DESIGN, *words)
    assert ended.code == 2
    assert told in ended.err
    assert ended.err.count("\n") == 1


def test_a_design_stays_within_what_was_run(run: Run, arm: Any, tmp_path: Path) -> None:
    line, file = tmp_path / "line.npz", tmp_path / "within.yaml"
    write_recording(line, production(arm.robot, cycles=3, noise=0.1).recording)
    made = run(*DESIGN, "--from", line, "-o", file, "--json").json
    assert made["margins"]["kept"]
    ran, motion = read_recording(line), Excitation.read(file).samples()
    assert np.all(motion.q.min(axis=0) >= ran.q.min(axis=0))
    assert np.all(motion.q.max(axis=0) <= ran.q.max(axis=0))
    speed = np.abs(np.gradient(ran.q, 1 / 125.0, axis=0)).max(axis=0)
    assert np.all(np.abs(motion.dq).max(axis=0) <= speed)
    tool, been = (arm.robot.rigid.frame_position(q, arm.robot.end_effector) for q in (motion.q, ran.q))
    assert np.all(tool.max(axis=0) <= been.max(axis=0) + 1e-3)
    assert any("been before" in rule["rule"] for rule in made["margins"]["workspace"])


@pytest.mark.long
def test_a_tour_of_waypoints_is_simulated_and_identified(run: Run, tmp_path: Path) -> None:
    (tmp_path / "list.yaml").write_text(WAYPOINTS, encoding="utf-8")
    file, bag = tmp_path / "tour.yaml", tmp_path / "tour.npz"
    made = run("design", "--waypoints", tmp_path / "list.yaml", "--moves", "8", "-o", file, "--json").json
    assert made["waypoints"]["poses"][0] == made["waypoints"]["poses"][-1]
    assert load_motion(file).duration == pytest.approx(made["waypoints"]["duration"])
    assert run("simulate", file, "-o", bag).code == 0
    found = run("identify", bag, "-o", tmp_path / "model.yaml", "--json").json
    assert found["recordings"][0]["repeats"] >= 7
    assert run("predict", tmp_path / "model.yaml", file, "-o", tmp_path / "task.npz").code == 0
    refused = run("design", "--waypoints", tmp_path / "list.yaml", "--symmetric", "--bound")
    assert "does not go with --symmetric, --bound" in refused.err


def test_check_counts_the_periods_of_an_excitation(run: Run, excitation: Path) -> None:
    told = run("check", excitation, "--precision", "5%", "--parameter", "p8", "--json").json["precision"]
    (one,) = told["parameters"]
    assert one["name"] == "p8"
    assert told["periods"] == one["periods"] == int(np.ceil((one["sigma"] / (0.05 * abs(one["value"]))) ** 2))
    assert told["seconds"] == pytest.approx(10.0 * told["periods"])
    assert "periods for 5 %" in run("check", excitation, "--precision", "0.05").out

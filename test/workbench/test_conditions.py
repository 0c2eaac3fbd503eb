"""Recordings whose currents or payloads nobody knows: a session finds gains and bodies as the command line does."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from robot_ident.bags import write_recording
from robot_ident.cli.main import main
from robot_ident.model.model import Model
from robot_ident.model.model_file import read_model
from robot_ident.provenance import config_file
from robot_ident.recording.conditions import Conditions, KnownPayload
from robot_ident.robot import Robot, load_robot
from robot_ident.testbed.calibrate import standard_motions
from robot_ident.testbed.phenomena import plant_physics
from robot_ident.testbed.simulation import Play
from robot_ident.workbench.allowed_paths import Allowed
from robot_ident.workbench.controller import Desk
from robot_ident.workbench.view import View

BODY = "payload:payload=15,x=0.05,y=0.1,z=0.2"
KNOWN = Conditions(KnownPayload(15.0, (0.05, 0.1, 0.2)))
UNKNOWN = Conditions(estimated=True, body="box")
HOSE = "cable@joint_2"


def robot_file(folder: Path, *, current: bool, known: bool) -> Path:
    """Write the example robot, which reports torque or current, with or without its drives' Nm/A."""
    data = yaml.safe_load(config_file("robots/kuka_ir361.yaml").read_text(encoding="utf-8"))
    data["urdf"] = str(config_file("robots/kuka_ir361.urdf"))
    data |= {"effort": "current"} if current else {}
    for joint in data["joints"].values() if not known else ():
        del joint["torque_constant"]
    path = folder / f"{'known' if known else 'arm'}.yaml"
    path.write_text(yaml.safe_dump(data, sort_keys=False), encoding="utf-8")
    return path


def write_runs(folder: Path, robot: Robot, conditions: Conditions) -> None:
    """Write a recording of the empty arm, one with a body in the hand, and one to judge by, all pulled by a hose."""
    factor = 1.0 if robot.effort.of("joint_2").quantity == "torque" else 29.56
    hose = np.array([0.0, 40.0 / factor, 0.0])
    for number, (name, effects) in enumerate((("plain", []), ("loaded", [BODY]), ("unseen", [BODY]))):
        play = Play.of(robot, plant_physics(robot, effects), standard_motions(robot)[number % 2], sample_rate=50.0)
        run = play.record(8, seed=number)
        write_recording(folder / f"{name}.npz", replace(run, tau=run.tau + hose * (run.q - 0.2)))
        if effects:
            (folder / f"{name}.npz.conditions.yaml").write_text(conditions.text(), encoding="utf-8")


@pytest.mark.parametrize(
    "current", [True, pytest.param(False, marks=pytest.mark.long)], ids=["unknown gains", "unknown payload"]
)
def test_a_session_finds_what_the_command_line_finds(
    current: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from .conftest import Bench

    write_runs(tmp_path, load_robot(robot_file(tmp_path, current=current, known=True)), KNOWN if current else UNKNOWN)
    robot = robot_file(tmp_path, current=current, known=not current)
    monkeypatch.chdir(tmp_path)
    desk = Desk(tmp_path / "sessions", Allowed(tmp_path))
    bench = Bench(desk.open(["plain.npz", "loaded.npz"], ["unseen.npz"], robot=robot.name))
    try:
        bench.do("open")
        bench.do("add", number=0, label=HOSE, new=1)
    finally:
        desk.close()
    assert main(["identify", "plain.npz", "loaded.npz", "--robot", str(robot), "-o", "model.yaml"]) == 0
    words = ["--bag", "plain.npz", "loaded.npz", "--validation", "unseen.npz", "-o", "better.yaml", "--json"]
    capsys.readouterr()
    assert main(["add", "model.yaml", HOSE, *words]) == 0
    told = json.loads(capsys.readouterr().out)
    models = [read_model(bench.session.model_file(number)) for number in (0, 1)]
    for mine, theirs in zip(models, (read_model("model.yaml"), read_model("better.yaml")), strict=True):
        np.testing.assert_allclose(mine.values, theirs.values, rtol=1e-6)
        np.testing.assert_allclose(mine.std, theirs.std, rtol=1e-6)
    (before, _), (after, std) = (found(model, current) for model in models)
    assert before != pytest.approx(after, rel=1e-4), "found anew with the effect"
    assert abs(after - (29.56 if current else 15.0)) < 3 * std
    for number, key in ((0, "before"), (1, "after")):
        check_view(View(bench.session, number), told[f"validation_mse_{key}"])


def found(model: Model, current: bool) -> tuple[float, float]:
    """Return the gain of the second drive, or the mass of the payload, and its standard deviation."""
    (told,) = [one for one in model.gains or () if one["joint"] == "joint_2"] if current else model.payloads
    name = ("value", "std") if current else ("mass", "mass_std")
    return float(told[name[0]]), float(told[name[1]])


def check_view(view: View, unseen: Mapping[str, Any]) -> None:
    """Check that the residual that is drawn is the one that is told: one measurement stands behind both."""
    for joint, name in enumerate(view.joints):
        squares = [view.residual[k][view.rows[k].weight[:, joint] > 0, joint] ** 2 for k in view.training]
        assert np.mean(np.concatenate(squares)) == pytest.approx(view.errors["training"][name], rel=0.02)
        assert view.errors["validation"][name] == pytest.approx(unseen[name], rel=1e-6)


def test_without_a_payload_a_session_stays_in_ampere(tmp_path: Path) -> None:
    from .conftest import Bench

    write_runs(tmp_path, load_robot(robot_file(tmp_path, current=True, known=True)), KNOWN)
    robot = robot_file(tmp_path, current=True, known=False)
    desk = Desk(tmp_path / "sessions", Allowed(tmp_path))
    bench = Bench(desk.open(["plain.npz"], robot=robot.name))
    try:
        bench.do("open")
        bench.do("add", number=0, label=HOSE, new=1)
    finally:
        desk.close()
    before, after = (View(bench.session, number) for number in (0, 1))
    assert {after.unit(joint) for joint in range(3)} == {"A"}
    assert after.errors["training"]["joint_2"] < before.errors["training"]["joint_2"]
    noise = after.errors["noise"]
    assert all(after.errors["training"][name] < 1.5 * noise[name] for name in after.joints)

"""A driver's raw bag, `init` and `info`: what it holds is understood and what it isn't is said.

The whole ways to compiled functions take minutes: acceptance/test_walkthroughs.py.
"""

from __future__ import annotations

import json
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path
from typing import Any

import pytest
from drivers import UR_CONSTANT, UR_ORDER, franka_at_work, ur10e_at_work

from robot_ident.bags import read_recording
from robot_ident.cli.main import main


def said(*words: object) -> Any:
    out = StringIO()
    with redirect_stdout(out):
        assert main([*map(str, words), "--json"]) == 0
    return json.loads(out.getvalue())


def test_currents_of_a_ur10e(robots_folder: Path, tmp_path: Path) -> None:
    course = ur10e_at_work(tmp_path, robots_folder, cycles=8, only="empty")
    bag, robot = tmp_path / "empty", tmp_path / "arm.yaml"
    recording = read_recording(bag)
    assert recording.names == tuple(f"{word}_joint" for word in UR_ORDER)
    pan = recording.names.index("shoulder_pan_joint")
    assert recording.tau[:, pan] * UR_CONSTANT["shoulder_pan"] == pytest.approx(course.tau[:, 0], abs=1e-9)
    drafted = said("init", "--bag", bag, "--acceleration", 6, "-o", robot)
    assert drafted["missing"] == []
    assert drafted["moving"][0] == "shoulder_pan_joint", "in the order of the chain"
    told = said("info", bag, "--robot", robot)
    verdicts = {one["joint"]: one["verdict"] for one in told["declaration"]}
    assert {verdicts[f"{word}_joint"] for word in ("shoulder_lift", "elbow")} == {"factor"}
    assert verdicts["shoulder_pan_joint"] in ("factor", "not_told"), "an upright axis carries no weight"
    assert told["recording"]["cycles"]["count"] >= 7


@pytest.mark.long
def test_topics_of_a_franka(robots_folder: Path, tmp_path: Path) -> None:
    franka_at_work(tmp_path, robots_folder, cycles=2, only="fresh")
    bag, robot = tmp_path / "fresh", tmp_path / "arm.yaml"
    topic = "/franka/joint_states"
    drafted = said("init", "--bag", bag, "--topic", topic, "--acceleration", 4, "-o", robot)
    assert len(drafted["moving"]) == 7
    assert set(drafted["held"]) == {"panda_finger_joint1", "panda_finger_joint2"}
    told = said("info", bag, "--topic", topic, "--robot", robot)
    assert told["recording"]["sample_rate"] == pytest.approx(1000.0, rel=1e-3)
    assert "consistent" in {one["verdict"] for one in told["declaration"]}

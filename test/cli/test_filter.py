"""`filter`: from two bags to the line of the robot YAML, which `identify` then heeds."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from robot_ident.robot.anti_alias import AntiAlias

Run = Callable[..., Any]


def test_two_bags_to_a_robot_yaml(run: Run, arm: Any, tmp_path: Path) -> None:
    from robot_ident.provenance import config_file
    from robot_ident.trajectories.excitation import Excitation

    motion = tmp_path / "motion.yaml"
    Excitation(arm.robot.name, arm.robot.joints, arm.series, 150.0).write(motion)
    plain, behind = tmp_path / "plain.npz", tmp_path / "behind.npz"
    assert run("simulate", motion, "--periods", 6, "--seed", 1, "-o", plain).code == 0
    assert run("simulate", motion, "--periods", 6, "--seed", 2, "--anti-alias", "-o", behind).code == 0
    found = run("filter", "--with", behind, "--without", plain, "--json").json
    assert found["delay"] == pytest.approx(AntiAlias(8, 40.0).delay, rel=0.03)
    assert run("filter", "--with", behind, "--without", plain, "--joint", "joint_2").code == 0

    urdf = config_file("robots", "kuka_ir361.urdf")
    described = yaml.safe_load(config_file("robots", "kuka_ir361.yaml").read_text())
    described |= {"urdf": str(urdf), **yaml.safe_load(found["yaml"])}
    robot = tmp_path / "mine.yaml"
    robot.write_text(yaml.safe_dump(described))
    model = run("identify", behind, "--robot", robot, "--json").json
    assert any("identified filter of order" in note for note in model["notes"])
    assert model["chi_square"] / model["dof"] < 1.15
    without = run("identify", behind, "--json").json
    assert without["chi_square"] / without["dof"] > 1.5


def test_a_file_in_words(run: Run, tmp_path: Path) -> None:
    frequency = np.geomspace(1.0, 100.0, 40)
    value = AntiAlias(3, 30.0).response(frequency)
    rows = "".join(
        f"{f},{abs(v)},{np.rad2deg(np.angle(v))},{abs(v) / 100}\n" for f, v in zip(frequency, value, strict=True)
    )
    path = tmp_path / "response.csv"
    path.write_text("frequency,gain,phase,deviation\n" + rows)
    told = run("filter", path)
    assert told.code == 0
    assert "order 3, -3 dB at 30 Hz" in told.out
    for words in ((), (path, "--with", path), ("--with", path)):
        refused = run("filter", *words)
        assert refused.code == 2
        assert "were expected" in refused.err

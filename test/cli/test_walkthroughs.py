"""The pages that lead by the hand are walked through as they stand: every command, and what they say comes out."""

from __future__ import annotations

import re
import shlex
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from robot_ident.effects import CATALOGUE
from robot_ident.robot import Robot
from robot_ident.trajectories.excitation import Excitation
from robot_ident.trajectories.fourier_series import FourierSeries

Run = Callable[..., Any]


@pytest.fixture(autouse=True)
def untouched_catalogue() -> Iterator[None]:
    before = dict(CATALOGUE)
    yield
    CATALOGUE.clear()
    CATALOGUE.update(before)


def motion(path: Path, robot: Robot, seed: int) -> None:
    """Write a motion that nobody searched for: a design takes seconds, and has tests of its own."""
    a, b = 0.2 * np.random.default_rng(seed).normal(size=(2, robot.n, 5))
    series = FourierSeries(0.1, np.array([0.0, -0.1, -0.2]), a, b)
    Excitation(robot.name, robot.joints, series, 150.0).write(path)


class Walk:
    """Goes through a page: commands (`sh`) are run, files (`yaml`, `python`) written under the names they are given."""

    def __init__(self, run: Run, checkout: Path, files: dict[str, str], design: Callable[[Path, int], None]) -> None:
        self._run, self._checkout, self._files, self._design = run, checkout, files, design
        self.said: dict[str, str] = {}
        self.all: dict[str, list[str]] = {}
        self._diagnosed: dict[tuple[object, ...], Any] = {}

    def page(self, name: str) -> None:
        text = (self._checkout / name).read_text(encoding="utf-8")
        for kind, block in re.findall(r"^```(sh|yaml|python)\n(.*?)^```", text, re.MULTILINE | re.DOTALL):
            if kind in self._files:
                Path(self._files[kind]).write_text(block, encoding="utf-8")
                continue
            for line in block.replace("\\\n", " ").splitlines():
                self._command(shlex.split(line, comments=True))

    def _command(self, words: list[str]) -> None:
        if words[0] == "cp":
            shutil.copy(self._checkout / words[1], words[2])
            return
        assert words[0] == "robot_ident", words
        verb, rest = words[1], words[2:]
        if verb == "design":
            self._design(Path(rest[rest.index("-o") + 1]), int(rest[rest.index("--seed") + 1]))
            return
        # a diagnosis reads files and writes none: the same words on the same files need no second run
        stamps = (Path(word).stat().st_mtime_ns if Path(word).exists() else 0 for word in rest)
        key = (*rest, *stamps) if verb == "diagnose" else ()
        done = self._diagnosed.get(key) or self._run(verb, *rest)
        if key:
            self._diagnosed[key] = done
        assert done.code == 0, f"{shlex.join(words)}: {done.err}"
        self.said[verb] = done.out
        self.all.setdefault(verb, []).append(done.out)


def test_the_first_page(run: Run, arm: Any, checkout: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """README.md, on recordings of a robot with the effect that it names; then the pages that go on from there."""
    monkeypatch.chdir(tmp_path)
    shutil.copy(checkout / "config/robots/kuka_ir361.urdf", "my_arm.urdf")
    for number in (1, 2, 3):
        motion(Path(f"motion_{number}.yaml"), arm.robot, number)
        hidden = ["--effect", "stribeck@joint_2:20", "--periods", 8, "--seed", number, "-o", f"run_{number}"]
        assert run("simulate", f"motion_{number}.yaml", *hidden).code == 0
    walk = Walk(run, checkout, {}, lambda path, seed: motion(path, arm.robot, seed))
    walk.page("README.md")
    assert walk.said["info"].count("consistent") == 3
    first, after = walk.all["compare"]
    assert re.search(r"joint_2 .*does not fit", first) and re.search(r"joint_2 .* fits", after)
    assert "missing: stribeck@joint_2" in walk.said["diagnose"]
    assert "adequate" in walk.said["report"] or "lacks stribeck@joint_2" in walk.said["report"]
    walk.page("docs/recordings.md")
    walk.page("docs/design.md")
    assert "every limit is kept" in walk.said["check"]


@pytest.mark.long
def test_your_own_robot_in_five_steps(
    run: Run, checkout: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)

    def design(path: Path, seed: int) -> None:
        motion(path, Robot.load("my_arm.yaml"), seed)

    walk = Walk(run, checkout, {"yaml": "my_arm.yaml"}, design)
    walk.page("docs/your_robot.md")
    assert "every limit is kept" in walk.said["check"]
    assert walk.said["info"].count("consistent") == 3
    assert "missing: stribeck@joint_2" in walk.said["diagnose"]
    assert Path("report.html").stat().st_size < 6e6
    nodes = re.findall(r"^robot_ident_(\w+)", (checkout / "docs/your_robot.md").read_text(), re.MULTILINE)
    assert nodes
    assert all((checkout / "config" / f"{node}.yaml").is_file() for node in nodes)


def test_export_a_model(run: Run, arm: Any, checkout: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    walk = Walk(run, checkout, {}, lambda path, seed: motion(path, arm.robot, seed))
    walk.page("docs/export.md")
    named = re.findall(r"`NAME_(\w+)\(", (checkout / "docs/export.md").read_text(encoding="utf-8"))
    header = Path("controller/kuka_ir361.h").read_text(encoding="utf-8")
    assert named == ["torque", "gravity", "friction"] and all(f"kuka_ir361_{name}(" in header for name in named)
    assert all(word in Path("identified.xml").read_text() for word in ("damping", "frictionloss"))
    assert "<dynamics" in Path("identified.urdf").read_text()


@pytest.mark.long
def test_how_to_read_the_verdict(
    run: Run, arm: Any, checkout: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    walk = Walk(run, checkout, {}, lambda path, seed: motion(path, arm.robot, seed))
    walk.page("docs/diagnosis.md")
    assert "missing: stribeck@joint_2" in walk.said["diagnose"]
    first, over, beside, later = walk.all["compare"]
    assert re.search(r"joint_2 .*does not fit", first)
    assert re.search(r"joint_2, .*\|dq\| < .*% of the excess in .*% of the time", first)
    assert "joint_2, residual [Nm] as a function of dq [rad/s]" in over
    assert "better.yaml" in beside
    assert re.search(r"from better.yaml to june.yaml: 1 of \d+ parameters changed", later)
    assert re.search(r"joint_2 .*stribeck.level@joint_2 \+\d+", later)


@pytest.mark.long
def test_write_your_own_effect(
    run: Run, arm: Any, checkout: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for number in (1, 2):
        motion(Path(f"excitation_{number}.yaml"), arm.robot, number)
    walk = Walk(run, checkout, {"python": "my_dent.py"}, lambda path, seed: None)
    text = (checkout / "docs/your_effect.md").read_text(encoding="utf-8")
    walk.page("docs/your_effect.md")
    assert "`dent@joint_1`" in text
    assert "missing: dent@joint_1" in walk.said["diagnose"]
    depth = re.search(r"dent\.depth@joint_1 = (\S+)", walk.said["add"])
    assert depth
    assert float(depth[1]) == pytest.approx(40.0, rel=0.1)

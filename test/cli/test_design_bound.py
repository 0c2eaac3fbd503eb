"""`design --bound --page`: the same figures on the terminal, in the file, in the JSON and on the page."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from robot_ident.trajectories.excitation import Excitation

URDF = """<robot name="slider"><link name="base"/>
<joint name="slide" type="prismatic"><parent link="base"/><child link="carriage"/><axis xyz="1 0 0"/>
<limit lower="-0.4" upper="0.4" velocity="0.5" effort="100"/></joint>
<link name="carriage"><inertial><mass value="5"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>
</link></robot>"""
YAML = """schema: robot_ident/robot/1
workspace: []
name: slider
urdf: slider.urdf
joints:
  slide: {acceleration: 2.0, torque_variance: 1.6}
"""


@pytest.fixture
def slider(tmp_path: Path) -> Path:
    (tmp_path / "slider.urdf").write_text(URDF, encoding="utf-8")
    (tmp_path / "slider.yaml").write_text(YAML, encoding="utf-8")
    return tmp_path / "slider.yaml"


def test_bound_and_page(
    run: Callable[..., Any], slider: Path, tmp_path: Path, checkout: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("robot_ident.design.multi_start.completed", _one_by_one)
    file, page = tmp_path / "excitation.yaml", tmp_path / "page.html"
    words = ["--robot", slider, "--harmonics", 3, "--base-frequency", 0.25, "--starts", 1, "-o", file]
    done = run("design", *words, "--bound", "--page", page, "--json")
    assert done.code == 0, done.err
    bound = done.json["bound"]
    assert bound["log10_det_covariance"] <= bound["relaxed"] <= done.json["log10_det_covariance"] + 1e-6
    share = 10 ** ((bound["log10_det_covariance"] - done.json["log10_det_covariance"]) / 3)
    assert bound["d_efficiency"] == pytest.approx(share) and 0.3 < share <= 1.0
    assert Excitation.read(file).achieved["bound"] == pytest.approx(bound)
    text = (checkout / "docs/json.md").read_text(encoding="utf-8")
    assert all(f"`{key}`" in text for key in bound)
    assert done.json["page"] == str(page)
    assert f"{bound['log10_det_covariance']:.2f}" in page.read_text(encoding="utf-8")
    again = run("design", *words, "--force", "--page", page.with_name("other.html"), "--time-limit", 30, "--bound")
    assert "D-efficiency at least" in again.out and "multi-start search" in again.out


def _one_by_one(function: Callable[[Any], Any], cases: Any, workers: int | None = None) -> Any:
    """Spare the start of processes."""
    for index, case in enumerate(cases):
        yield index, function(case)


def test_what_does_not_go_together(run: Callable[..., Any], tmp_path: Path) -> None:
    for option in (["--bound"], ["--page", tmp_path / "page.html"]):
        done = run("design", *option, "--tell", "stribeck@joint_2", "presliding@joint_2")
        assert done.code == 2 and f"{option[0]} goes with a criterion" in done.err
    (tmp_path / "there.html").write_text("mine", encoding="utf-8")
    done = run("design", "--page", tmp_path / "there.html")
    assert done.code == 2 and "exists already" in done.err
    assert (tmp_path / "there.html").read_text(encoding="utf-8") == "mine"

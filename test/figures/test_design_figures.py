"""The figures of a design: that they show what they say, in the colours and units that they promise."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from robot_ident.design.bound import Bound
from robot_ident.figures.parameter_bars import sigma_figure, sigma_text
from robot_ident.figures.theme import COLOURS, SHADES
from robot_ident.figures.tool_path import workspace_figure, workspace_text
from robot_ident.figures.trajectory import convergence_figure, convergence_text, trajectory_figure, trajectory_text
from robot_ident.paper.printed import LOG10_DET, PARAMETERS, SIGMA
from robot_ident.robot import Robot, load_robot

BOUND = Bound(-56.1, -55.9, 0.6, 21, 3, 1, 20, 60.0)
UNITS = ("kg m^2",) * 21


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot("kuka_ir361")


def named(figure: Any) -> dict[str, Any]:
    return {trace.name: trace for trace in figure.data}


def test_trajectory_shows_the_motion_and_its_limits(designed: Any, robot: Robot) -> None:
    figure = trajectory_figure(designed.excitation, robot)
    assert len(figure.data) == 9
    q, dq, ddq = designed.excitation.series.extremes()
    for joint in range(3):
        for trace, extremes in zip(figure.data[joint::3], (q, dq, ddq), strict=True):
            assert np.max(trace.y) == pytest.approx(extremes.upper[joint], abs=2e-3)
    levels = sorted({round(shape.y0, 3) for shape in figure.layout.shapes})
    assert levels == [-3.0, -1.6, -1.45, -1.2, 1.2, 1.45, 1.6, 3.0]
    assert [figure.layout[f"yaxis{k}"].title.text for k in ("", 2, 3)] == [
        "position [rad]",
        "velocity [rad/s]",
        "acceleration [rad/s²]",
    ]
    assert "joint_3 moves from" in trajectory_text(designed.excitation, robot)


def test_workspace_shades_what_the_rules_forbid(designed: Any, robot: Robot) -> None:
    figure = workspace_figure(designed.excitation, robot)
    side = next(trace for trace in figure.data if trace.name == "forbidden" and trace.xaxis == "x")
    r, z = np.meshgrid(side.x, side.y)
    clearly = np.minimum.reduce([np.abs(z - 0.8), np.abs(z - 1.8), np.abs(r - 0.7)]) > 0.05
    forbidden = (z < 0.8) | ((r < 0.7) & (z < 1.8))
    assert np.array_equal((np.array(side.z) < 0)[clearly], forbidden[clearly])
    path = next(trace for trace in figure.data if trace.name == "path of flange")
    assert min(path.y) > 0.8 and not np.any((np.array(path.x) < 0.7) & (np.array(path.y) < 1.8))
    names = [trace.name for trace in figure.data if trace.showlegend]
    assert len(names) == len(set(names)) == 4
    assert "flange" in workspace_text(designed.excitation, robot)


def test_a_robot_without_rules_has_nothing_shaded(designed: Any, robot: Robot) -> None:
    figure = workspace_figure(designed.excitation, replace(robot, workspace=()))
    assert {trace.type for trace in figure.data} == {"scatter"}


def test_convergence_shows_paper_and_bound(designed: Any) -> None:
    found = named(convergence_figure(designed, BOUND))
    best = found["best so far"]
    assert best.y[-1] == designed.log10_det_covariance and list(best.y) == sorted(best.y, reverse=True)
    assert found["no trajectory passes: -56.10"].y[0] == -56.1
    assert found["Swevers et al. 1997: -48.63"].y[0] == LOG10_DET["d-optimal"]
    assert "-56.10" in convergence_text(designed, BOUND)
    assert set(named(convergence_figure(replace(designed, parameters=("a", "b"))))) == {"best so far"}


def test_sigma_beside_table_two(designed: Any) -> None:
    assert designed.parameters == PARAMETERS
    found = named(sigma_figure(designed, UNITS))
    assert list(found["this design"].y) == list(designed.sigma)
    assert tuple(found["Swevers et al. 1997, Table II"].y) == SIGMA["d-optimal"]
    assert found["this design"].x[0] == "p1 [kg m²]"
    assert "21 parameters" in sigma_text(designed)
    other = replace(designed, excitations=(replace(designed.excitation, robot="other"),))
    assert set(named(sigma_figure(other, UNITS))) == {"this design"}


def test_colours_stand_out_from_the_page() -> None:
    """Lines keep a contrast of 2 to white and to the dark page, text one of 7 (WCAG)."""

    def light(code: str) -> float:
        parts = [int(code[k : k + 2], 16) / 255 for k in (1, 3, 5)]
        linear = [part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in parts]
        return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]

    def contrast(first: str, second: str) -> float:
        high, low = sorted((light(first), light(second)), reverse=True)
        return (high + 0.05) / (low + 0.05)

    for page, shade in (("#ffffff", "light"), ("#15181c", "dark")):
        assert contrast(SHADES[shade]["text"], page) > 7.0
        for code in COLOURS:
            assert contrast(code, page) > 2.0

"""Figures of the paper that no other page draws: the robot with its frames, sigmas beside Table II, the bound from
round to round, the filter's response, model 1 against model 2.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from robot_ident.figures.parameter_bars import sigmas_over_names
from robot_ident.figures.theme import BLUE, GREEN, GREY, ORANGE, PURPLE, VERMILLION, add_level, colour, themed
from robot_ident.paper import printed
from robot_ident.paper.excitation import Excitations
from robot_ident.paper.friction import Draws
from robot_ident.paper.measuring import NOMINAL, MeasuringChain
from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Array

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

    from robot_ident.testbed.redesign import Redesigned


_ARROW = 0.22  # m, of an axis of a frame
_LABELS = ("top right", "bottom right", "top left")  # by frame: those of axes 1 and 2 coincide
_BENT = (0.0, 0.7, 0.5)  # rad, the second pose


def robot_figure(robot: Robot) -> Figure:
    """Return the arm from the side (x, z) [m] as its URDF says, at q = 0 and bent, with every joint's frame; axes that
    point to the reader or away are not drawn.
    """
    from plotly.subplots import make_subplots

    poses = (("q = 0", np.zeros(robot.n)), (f"q = {_BENT} rad", np.array(_BENT[: robot.n])))
    figure = make_subplots(rows=1, cols=2, subplot_titles=[name for name, _ in poses], horizontal_spacing=0.08)
    for column, (_, q) in enumerate(poses, 1):
        place = {"row": 1, "col": column}
        frames = _frames(robot, q)
        way = np.array([np.zeros(3), *(origin for _, origin, _ in frames)])
        silent = {"line": {"color": GREY, "width": 10}, "showlegend": False, "hoverinfo": "skip"}
        figure.add_scatter(x=way[:, 0], y=way[:, 2], mode="lines", **silent, **place)
        for number, (name, origin, axes) in enumerate(frames[: robot.n]):
            for axis, shade in ((0, VERMILLION), (1, GREEN), (2, BLUE)):
                tip = origin + _ARROW * axes[:, axis]
                if np.hypot(*(tip - origin)[[0, 2]]) < 0.1 * _ARROW:
                    continue  # it points to the reader or away
                figure.add_scatter(
                    x=[origin[0], tip[0]],
                    y=[origin[2], tip[2]],
                    mode="lines+markers+text",
                    line={"color": shade, "width": 3},
                    marker={"size": [0, 8], "symbol": "arrow", "angleref": "previous", "color": shade},
                    text=["", f"{'xyz'[axis]}{number + 1}"],
                    textposition=_LABELS[number],
                    textfont={"color": shade},
                    showlegend=False,
                    hoverinfo="skip",
                    **place,
                )
            spot = {"size": 11, "color": colour(number), "line": {"width": 2, "color": GREY}}
            words = f"{name}: z {_toward(axes[:, 2])}<extra></extra>"
            look = {"mode": "markers", "marker": spot, "name": name, "legendgroup": name, "hovertemplate": words}
            figure.add_scatter(x=[origin[0]], y=[origin[2]], showlegend=column == 1, **look, **place)
        square = {"size": 11, "symbol": "square", "color": GREY}
        end = {"mode": "markers", "marker": square, "name": robot.end_effector, "legendgroup": "end"}
        figure.add_scatter(x=way[-1:, 0], y=way[-1:, 2], showlegend=column == 1, **end, **place)
        figure.update_xaxes(title_text="x [m]", range=[-0.8, 1.4], constrain="domain", **place)
        figure.update_yaxes(range=[-0.1, 2.6], scaleanchor="x" if column == 1 else "x2", constrain="domain", **place)
    figure.update_yaxes(title_text="z [m]", row=1, col=1)
    return themed(figure, height=580, margin={"t": 76}, legend={"y": 1.07})


def _frames(robot: Robot, q: Array) -> list[tuple[str, Array, Array]]:
    """Return name, origin [3] m and axes [3, 3] in the base of every joint's frame, and of the end effector."""
    import pinocchio

    model = robot.rigid.model
    data = model.createData()
    pinocchio.framesForwardKinematics(model, data, q)
    places = [(name, data.oMi[1 + k]) for k, name in enumerate(robot.joints)]
    places.append((robot.end_effector, data.oMf[model.getFrameId(robot.end_effector)]))
    return [(name, np.array(place.translation), np.array(place.rotation)) for name, place in places]


def _toward(axis: Array) -> str:
    if abs(axis[1]) < 0.5:
        return "in the plane of the picture"
    return "away from the reader" if axis[1] > 0 else "to the reader"


def robot_text(robot: Robot) -> str:
    """Return in words what the figure shows."""
    heights = [f"{name} at {origin[2]:.3f} m" for name, origin, _ in _frames(robot, np.zeros(robot.n))]
    return f"The arm from the side, stretched up at q = 0 and bent. Heights at q = 0: {', '.join(heights)}."


def sigmas_figure(found: Excitations) -> Figure:
    """Return the standard deviations of Table II: of both trajectories, printed and here, on a logarithmic axis."""
    series = [
        (f"{name}, {who}", values, shade, symbol)
        for criterion, name, shade in (("condition", "c1", ORANGE), ("d-optimal", "c2", BLUE))
        for who, values, symbol in (
            ("paper", printed.SIGMA[criterion], "diamond-open"),
            ("here", list(found.optimal[criterion].runs.sigma), "circle"),
        )
    ]
    return sigmas_over_names(found.names, series, "standard deviation [SI units]", 480)


def rounds_figure(found: Redesigned, bound: float) -> Figure:
    """Return log10 det of the Cramer-Rao bound from round to round, above what no trajectory passes."""
    from plotly.graph_objects import Figure

    rounds = list(range(1, len(found.rounds) + 1))
    values = [one.log10_det_bound for one in found.rounds]
    figure, line = Figure(), {"color": BLUE, "width": 2}
    figure.add_scatter(x=rounds, y=values, mode="lines+markers", line=line, marker={"size": 9}, name="at its estimate")
    span = [0.8, len(rounds) + 0.2]
    add_level(figure, span, bound, "no trajectory passes", GREEN, "dot")
    add_level(figure, span, printed.LOG10_DET["d-optimal"], "the paper's c2", ORANGE, "dash")
    figure.update_xaxes(title_text="measurement", dtick=1, range=span)
    figure.update_yaxes(title_text="log10 det of the bound")
    return themed(figure, height=360)


def response_figure(found: MeasuringChain) -> Figure:
    """Return gain and phase of the filter over frequency: measured, identified, the nominal Butterworth filter."""
    from plotly.subplots import make_subplots

    figure = make_subplots(rows=2, cols=1, shared_xaxes=True, vertical_spacing=0.06)
    grid = np.geomspace(found.response.frequency[0], found.response.frequency[-1], 300)
    curves = (
        ("measured", found.response.frequency, found.response.value, GREY, "markers"),
        ("nominal Butterworth", grid, NOMINAL.response(grid), ORANGE, "lines"),
        ("identified", grid, found.identified.filter.response(grid), BLUE, "lines"),
    )
    for name, frequency, value, shade, mode in curves:
        look = {
            "mode": mode,
            "name": name,
            "legendgroup": name,
            "line": {"color": shade, "width": 2},
            "marker": {"color": shade, "size": 5},
        }
        figure.add_scatter(x=frequency, y=np.abs(value), **look, row=1, col=1)
        phase = np.rad2deg(np.unwrap(np.angle(value)))
        figure.add_scatter(x=frequency, y=phase, showlegend=False, **look, row=2, col=1)
    figure.update_yaxes(title_text="gain", type="log", row=1, col=1)
    figure.update_yaxes(title_text="phase [deg]", row=2, col=1)
    figure.update_xaxes(type="log")
    figure.update_xaxes(title_text="frequency [Hz]", row=2, col=1)
    return themed(figure, height=480)


def draws_figure(draws: Draws, joints: tuple[str, ...]) -> Figure:
    """Return by which share model 1 errs more than model 2 on each draw of the validation motion, by joint."""
    from plotly.graph_objects import Figure

    figure = Figure()
    for joint, name in enumerate(joints):
        figure.add_box(
            y=100.0 * draws.worse[:, joint],
            name=name,
            boxpoints="all",
            jitter=0.4,
            pointpos=0.0,
            marker={"color": colour(joint), "size": 6},
            line={"color": colour(joint)},
            showlegend=False,
        )
    figure.add_hline(100.0 * printed.MODEL_1_WORSE, line={"color": PURPLE, "dash": "dash", "width": 2})
    figure.update_yaxes(title_text="model 1 worse than model 2 [%]")
    return themed(figure, height=420)

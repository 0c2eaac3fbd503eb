"""The way of a frame through the workspace, from the side and from above, with forbidden regions shaded."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from robot_ident.figures.theme import BLUE, FORBIDDEN, GREEN, PARTLY_FORBIDDEN, themed
from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Array
from robot_ident.trajectories.excitation import Excitation

if TYPE_CHECKING:
    from plotly.graph_objects import Figure


_POINTS = 801
_GRID = 90
_THROUGH = 25  # depths (angles about the vertical, heights) at which a rule is asked
_ROOM = 0.15  # share of the view that is left around the path


def workspace_figure(excitation: Excitation, robot: Robot, frame: str | None = None) -> Figure:
    """Return the path of a frame (the end effector) in (r, z), r its distance from the base's vertical, and in (x, y).

    Shaded dark: where the rules for this frame forbid every point behind the picture's; light: where only some (at
    other angles from the side, at other heights from above).
    """
    from plotly.subplots import make_subplots

    frame = frame or robot.end_effector
    p = _path(excitation, robot, frame)
    r = np.hypot(p[:, 0], p[:, 1])
    figure = make_subplots(
        rows=1, cols=2, horizontal_spacing=0.1, subplot_titles=("from the side", "from above")
    )  # plotly puts the titles where the legend would be
    side, above = _spans(r, p[:, 2], floor=0.0), _spans(p[:, 0], p[:, 1], equal=True)
    for column, spans in ((1, side), (2, above)):
        for region in _shading(robot, frame, spans, p, from_side=column == 1):
            first = region["name"] not in {other.name for other in figure.data}
            figure.add_contour(**region, showlegend=first, row=1, col=column)
    line = {"color": BLUE, "width": 2}
    words = ("r %{x:.3f} m, z %{y:.3f} m", "x %{x:.3f} m, y %{y:.3f} m")
    for column, (x, y) in enumerate(((r, p[:, 2]), (p[:, 0], p[:, 1])), 1):
        hover = f"{words[column - 1]}<extra>{frame}</extra>"
        shown = {"showlegend": column == 1, "legendgroup": "path", "hovertemplate": hover}
        place = {"row": 1, "col": column}
        figure.add_scatter(x=x, y=y, mode="lines", line=line, name=f"path of {frame}", **shown, **place)
        start = {"size": 10, "color": GREEN, "symbol": "diamond"}
        shown |= {"legendgroup": "start", "hovertemplate": f"start, {hover}"}
        figure.add_scatter(x=x[:1], y=y[:1], mode="markers", marker=start, name="start", **shown, **place)
    for column, ((low, high), (bottom, top)) in enumerate((side, above), 1):
        figure.update_xaxes(range=[low, high], constrain="domain", row=1, col=column)
        anchor = "x" if column == 1 else "x2"  # a metre is as long in both directions
        figure.update_yaxes(range=[bottom, top], scaleanchor=anchor, constrain="domain", row=1, col=column)
    figure.update_xaxes(title_text="distance from the vertical axis r [m]", row=1, col=1)
    figure.update_yaxes(title_text="height z [m]", row=1, col=1)
    figure.update_xaxes(title_text="x [m]", row=1, col=2)
    figure.update_yaxes(title_text="y [m]", row=1, col=2)
    return themed(figure, height=520, margin={"t": 84}, legend={"y": 1.1})


def workspace_text(excitation: Excitation, robot: Robot, frame: str | None = None) -> str:
    """Return in words what the figure shows."""
    frame = frame or robot.end_effector
    p = _path(excitation, robot, frame)
    r = np.hypot(p[:, 0], p[:, 1])
    rules = [rule.text for rule in robot.workspace if rule.frame == frame]
    kept = f" Rules: {'; '.join(rules)}." if rules else ""
    return (
        f"The path of {frame}: height {p[:, 2].min():.2f} to {p[:, 2].max():.2f} m, distance from the vertical axis"
        f" {r.min():.2f} to {r.max():.2f} m, seen from the side and from above.{kept}"
    )


def _path(excitation: Excitation, robot: Robot, frame: str) -> Array:
    q = excitation.series.motion(np.linspace(0.0, excitation.period, _POINTS)).q
    return np.round(robot.rigid.frame_position(q, frame), 5)


Spans = tuple[tuple[float, float], tuple[float, float]]


def _spans(x: Array, y: Array, *, floor: float | None = None, equal: bool = False) -> Spans:
    """Return what is seen of two coordinates [m]; with `floor` the view begins there at the latest."""
    low, high = np.array([x.min(), y.min()]), np.array([x.max(), y.max()])
    if floor is not None:
        low = np.minimum(low, floor)
    if equal:
        low, high = np.minimum(low, -0.2), np.maximum(high, 0.2)
    room = _ROOM * float((high - low).max())
    first = low - (0.0 if floor is not None else room)
    return (float(first[0]), float(high[0] + room)), (float(first[1]), float(high[1] + room))


def _shading(robot: Robot, frame: str, spans: Spans, path: Array, *, from_side: bool) -> list[dict[str, Any]]:
    """Return contours that fill where the rules forbid some, and where they forbid all, of what is behind a point."""
    rules = [rule for rule in robot.workspace if rule.frame == frame]
    if not rules:
        return []
    x, y = (np.linspace(*span, _GRID) for span in spans)
    u, v, w = np.meshgrid(x, y, np.linspace(0.0, 1.0, _THROUGH), indexing="ij")
    if from_side:
        angle = 2.0 * np.pi * w
        points = np.stack([u * np.cos(angle), u * np.sin(angle), v], axis=-1)
    else:
        heights = path[:, 2].min(), path[:, 2].max()
        points = np.stack([u, v, heights[0] + w * (heights[1] - heights[0])], axis=-1)
    margin = np.min([rule.margin(points.reshape(-1, 3)) for rule in rules], axis=0).reshape(u.shape)
    out = []
    for values, fill, name in (
        (margin.min(axis=2), PARTLY_FORBIDDEN, "forbidden at some angles or heights"),
        (margin.max(axis=2), FORBIDDEN, "forbidden"),
    ):
        if values.min() < 0.0:
            grid = {"x": np.round(x, 4), "y": np.round(y, 4), "z": np.round(values.T, 4).astype("float32")}
            look = {"fillcolor": fill, "line": {"width": 1, "color": "rgba(213, 94, 0, 0.6)"}, "hoverinfo": "skip"}
            region = {"type": "constraint", "operation": ">", "value": 0.0}  # what keeps it is left clear
            out.append({"contours": region, "name": name, "legendgroup": name, **grid, **look})
    return out

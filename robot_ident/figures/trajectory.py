"""Position, velocity and acceleration of all joints over a period, with their limits (the paper's Figs. 2 and 3), and
the best value found over the time of a search, beside the bound and the paper's value.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from robot_ident.design.bound import Bound
from robot_ident.design.design import DesignResult
from robot_ident.figures.parameter_bars import is_paper_model
from robot_ident.figures.theme import BLUE, GREEN, GREY, ORANGE, add_level, colour, dash, themed, trace
from robot_ident.paper.printed import CONDITION, LOG10_DET
from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Array
from robot_ident.trajectories.excitation import Excitation
from robot_ident.trajectories.point_to_point import PointToPoint

if TYPE_CHECKING:
    from plotly.graph_objects import Figure


_POINTS = 401
_ROOM = 0.06  # above and below the limits
_QUANTITIES = ("position", "velocity", "acceleration")


def trajectory_figure(excitation: Excitation, robot: Robot) -> Figure:
    """Return q, dq and ddq over one period in three panels; limits are dashed, in a joint's colour where it differs."""
    return trajectories_figure({"": excitation}, robot)


def trajectories_figure(excitations: Mapping[str, Excitation], robot: Robot) -> Figure:
    """Return q, dq and ddq over one period, a column for each motion by its name; limits are dashed."""
    from plotly.subplots import make_subplots

    several = len(excitations) > 1
    figure = make_subplots(
        rows=3,
        cols=len(excitations),
        shared_xaxes=True,
        shared_yaxes=several,
        vertical_spacing=0.04,
        horizontal_spacing=0.04,
        column_titles=list(excitations) if several else None,
    )
    for column, excitation in enumerate(excitations.values(), 1):
        t = np.linspace(0.0, excitation.period, _POINTS)
        motion = excitation.series.motion(t)
        for row, values in enumerate((motion.q, motion.dq, motion.ddq), 1):
            place = {"row": row, "col": column}
            for joint, name in enumerate(excitation.joints):
                figure.add_trace(_curve(t, values[:, joint], robot, joint, name, row - 1, row + column == 2), **place)
            for value, shade in _limits(robot, row - 1):
                figure.add_hline(value, line={"color": shade, "dash": "dash", "width": 1}, **place)
    for row in (1, 2, 3):
        motions = [one.series.motion(np.linspace(0.0, one.period, _POINTS)) for one in excitations.values()]
        reached = [float(v) for m in motions for x in ((m.q, m.dq, m.ddq)[row - 1],) for v in (x.min(), x.max())]
        shown = [*reached, *(value for value, _ in _limits(robot, row - 1))]
        room = _ROOM * (max(shown) - min(shown))
        figure.update_yaxes(range=[min(shown) - room, max(shown) + room], row=row)
        figure.update_yaxes(title_text=f"{_QUANTITIES[row - 1]} [{_units(robot, row - 1)}]", row=row, col=1)
    figure.update_xaxes(title_text="time [s]", row=3)
    above = {"margin": {"t": 76}, "legend": {"y": 1.05}} if several else {}  # the columns' titles stand there
    return themed(figure, height=720, hovermode="x unified", **above)


def point_to_point_figure(motion: PointToPoint, robot: Robot) -> Figure:
    """Return the positions over time of a motion from point to point."""
    from plotly.graph_objects import Figure

    figure = Figure()
    t = np.linspace(0.0, motion.duration, 4 * _POINTS)
    q = motion.reference(t).q
    for joint, name in enumerate(motion.joints):
        figure.add_trace(_curve(t, q[:, joint], robot, joint, name, 0, True))
    figure.update_xaxes(title_text="time [s]")
    figure.update_yaxes(title_text=f"position [{_units(robot, 0)}]")
    return themed(figure, height=340, hovermode="x unified")


def _curve(t: Array, values: Array, robot: Robot, joint: int, name: str, order: int, shown: bool) -> Any:
    line = {"color": colour(joint), "dash": dash(joint), "width": 2}
    hover = f"%{{y:.3f}} {_unit(robot.prismatic[joint], order)}"
    return trace(name, shown, hover, x=t, y=np.round(values, 6), mode="lines", line=line)


def trajectory_text(excitation: Excitation, robot: Robot) -> str:
    """Return in words what the figure shows."""
    q, dq, ddq = excitation.series.extremes()
    parts = [
        f"{name} moves from {q.lower[k]:.2f} to {q.upper[k]:.2f} {_unit(robot.prismatic[k], 0)},"
        f" at most {dq.largest[k]:.2f} per s and {ddq.largest[k]:.2f} per s squared"
        for k, name in enumerate(excitation.joints)
    ]
    return f"Position, velocity and acceleration over one period of {excitation.period:g} s. {'; '.join(parts)}."


def _limits(robot: Robot, order: int) -> list[tuple[float, str]]:
    """Return the limits to draw with their colours: grey where all joints share one."""
    limits = robot.limits
    pairs = (
        (limits.lower, limits.upper),
        (-limits.velocity, limits.velocity),
        (-limits.acceleration, limits.acceleration),
    )[order]
    out: dict[float, str] = {}
    for side in pairs:
        for value in np.unique(side[np.isfinite(side)]):
            joints = np.flatnonzero(side == value)
            out[float(value)] = colour(int(joints[0])) if len(joints) == 1 and robot.n > 1 else GREY
    return list(out.items())


def _unit(slides: bool, order: int) -> str:
    return ("m" if slides else "rad") + ("", "/s", "/s²")[order]


def _units(robot: Robot, order: int) -> str:
    return ", ".join(dict.fromkeys(_unit(slides, order) for slides in robot.prismatic))


def convergence_figure(found: DesignResult, bound: Bound | None = None) -> Figure:
    """Return the criterion's best value over time, as steps, with the bound and (for its robot) the paper's value."""
    from plotly.graph_objects import Figure

    seconds, costs = _history(found)
    figure = Figure()
    figure.add_scatter(
        x=seconds,
        y=costs,
        mode="lines+markers",
        line={"shape": "hv", "color": BLUE, "width": 2},
        marker={"size": 6},
        name="best so far",
        hovertemplate="%{y:.3f} after %{x:.1f} s<extra></extra>",
    )
    for reference in _references(found, bound):
        add_level(figure, [0.0, max(seconds[-1], 1.0)], *reference)
    figure.update_xaxes(title_text="time of the search [s]", rangemode="tozero")
    figure.update_yaxes(title_text="condition number" if _by_condition(found) else "log10 det of the covariance")
    return themed(figure, height=380)


def convergence_text(found: DesignResult, bound: Bound | None = None) -> str:
    """Return in words what the figure shows."""
    seconds, costs = _history(found)
    what = "condition number" if _by_condition(found) else "log10 of the determinant"
    references = "".join(f" {name}: {value:.2f}." for value, name, _, _ in _references(found, bound))
    return (
        f"The best {what} fell from {costs[0]:.2f} after {seconds[0]:.1f} s to {costs[-1]:.2f} when the search ended"
        f" after {seconds[-1]:.1f} s.{references}"
    )


def _by_condition(found: DesignResult) -> bool:
    return found.excitation.criterion == "condition"


def _history(found: DesignResult) -> tuple[list[float], list[float]]:
    """Return times and values, the last one at the end of the search."""
    last = found.condition_number if _by_condition(found) else found.log10_det_covariance
    history = [*found.history, (found.seconds, last)]
    return [time for time, _ in history], [cost for _, cost in history]


def _references(found: DesignResult, bound: Bound | None) -> list[tuple[float, str, str, str]]:
    """Return (value, name, colour, dash) of the lines beside the search."""
    out = []
    if is_paper_model(found.excitation.robot, found.parameters):
        value = CONDITION["condition"] if _by_condition(found) else LOG10_DET["d-optimal"]
        out.append((value, "Swevers et al. 1997", ORANGE, "dash"))
    if bound is not None and not _by_condition(found):
        out.append((bound.log10_det_covariance, "no trajectory passes", GREEN, "dot"))
    return out

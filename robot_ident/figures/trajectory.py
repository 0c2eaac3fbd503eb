"""Position, velocity and acceleration of all joints over a period, with their limits (the paper's Figs. 2 and 3)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from robot_ident.excitation.excitation import Excitation
from robot_ident.figures.theme import GREY, colour, dash, themed
from robot_ident.robot.robot import Robot

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

_POINTS = 401
_ROOM = 0.06  # above and below the limits
_QUANTITIES = ("position", "velocity", "acceleration")


def trajectory_figure(excitation: Excitation, robot: Robot) -> Figure:
    """Return q, dq and ddq over one period in three panels; limits are dashed, in a joint's colour where it differs."""
    from plotly.graph_objects import Scatter
    from plotly.subplots import make_subplots

    t = np.linspace(0.0, excitation.period, _POINTS)
    motion = excitation.series.motion(t)
    figure = make_subplots(rows=3, cols=1, shared_xaxes=True, vertical_spacing=0.04)
    for row, values in enumerate((motion.q, motion.dq, motion.ddq), 1):
        for joint, name in enumerate(excitation.joints):
            unit = _unit("m" if robot.prismatic[joint] else "rad", row - 1)
            figure.add_trace(
                Scatter(
                    x=t,
                    y=np.round(values[:, joint], 6),
                    name=name,
                    legendgroup=name,
                    showlegend=row == 1,
                    mode="lines",
                    line={"color": colour(joint), "dash": dash(joint), "width": 2},
                    hovertemplate=f"%{{y:.3f}} {unit}<extra>{name}</extra>",
                ),
                row=row,
                col=1,
            )
        limits = _limits(robot, row - 1)
        for value, shade in limits:
            figure.add_hline(value, line={"color": shade, "dash": "dash", "width": 1}, row=row, col=1)
        shown = [float(values.min()), float(values.max()), *(value for value, _ in limits)]
        room = _ROOM * (max(shown) - min(shown))
        figure.update_yaxes(range=[min(shown) - room, max(shown) + room], row=row, col=1)
        figure.update_yaxes(title_text=f"{_QUANTITIES[row - 1]} [{_units(robot, row - 1)}]", row=row, col=1)
    figure.update_xaxes(title_text="time [s]", row=3, col=1)
    return themed(figure, height=720, hovermode="x unified")


def trajectory_text(excitation: Excitation, robot: Robot) -> str:
    """Return in words what the figure shows."""
    q, dq, ddq = excitation.series.extremes()
    parts = [
        f"{name} moves from {q.lower[k]:.2f} to {q.upper[k]:.2f} {_unit('m' if robot.prismatic[k] else 'rad', 0)},"
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


def _unit(base: str, order: int) -> str:
    return base + ("", "/s", "/s²")[order]


def _units(robot: Robot, order: int) -> str:
    bases = dict.fromkeys("m" if slides else "rad" for slides in robot.prismatic)
    return ", ".join(_unit(base, order) for base in bases)

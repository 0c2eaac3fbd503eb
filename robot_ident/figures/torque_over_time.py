"""Measured and predicted torque over time, and the residual beside its noise: the paper's Figs. 4 and 5."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from robot_ident.figures.theme import MEASURED, NOISE, extremes, model_colour, plain, themed, trace
from robot_ident.residuals.beside import Beside
from robot_ident.signals.motion import Array

if TYPE_CHECKING:
    from plotly.graph_objects import Figure


def noise_band(x: Array, wide: float, label: str, *, shown: bool) -> dict[str, Any]:
    """Return the band from -wide to wide along x [N]; `shown`: it has an entry in the legend."""
    start, end = float(x[0]), float(x[-1])
    corners = {"x": [start, end, end, start], "y": [-wide, -wide, wide, wide]}
    look = {"fill": "toself", "fillcolor": NOISE, "line": {"width": 0}, "mode": "lines", "hoverinfo": "skip"}
    return {"type": "scatter", "name": label, "legendgroup": label, "showlegend": shown, **corners, **look}


_JOINT = 320  # px: torque above, residual below
BAND = 2.0
"""Standard deviations of the noise on either side of zero, within which it leaves 95 % of the rows."""


def torque_figure(besides: Mapping[str, Beside]) -> Figure:
    """Return torque and, below it, residual [Nm] of every joint over one period or recording.

    besides: by the name of the model, all of the same recording. The band is the noise of a row, +- 2 sigma. Long
    curves are drawn by the extremes of each stretch.
    """
    from plotly.subplots import make_subplots

    found = next(iter(besides.values()))
    robot = found.robot
    figure = make_subplots(
        rows=2 * robot.n,
        cols=1,
        shared_xaxes=True,
        vertical_spacing=0.12 / (2 * robot.n),
        row_heights=[0.58, 0.42] * robot.n,
    )
    for joint, name in enumerate(robot.joints):
        unit, upper, lower = robot.torque_unit(joint), 2 * joint + 1, 2 * joint + 2
        torque = _curve("measured", found.t, found.measured[:, joint], MEASURED, unit, joint)
        figure.add_trace(torque, row=upper, col=1)
        if np.isfinite(found.sigma[joint]):
            wide, label = BAND * float(found.sigma[joint]), f"noise, ± {BAND:g} sigma"
            figure.add_trace(noise_band(found.t, wide, label, shown=joint == 0), row=lower, col=1)
        for place, (model, one) in enumerate(besides.items()):
            colour = model_colour(place, len(besides))
            torque = _curve(f"predicted, {plain(model)}", one.t, one.predicted[:, joint], colour, unit, joint)
            rest = np.where(one.used[:, joint], one.residual[:, joint], np.nan)
            figure.add_trace(torque, row=upper, col=1)
            figure.add_trace(_curve(f"residual, {plain(model)}", one.t, rest, colour, unit, joint), row=lower, col=1)
        figure.update_yaxes(title_text=f"{plain(name)}<br>torque [{unit}]", row=upper, col=1)
        figure.update_yaxes(title_text=f"residual [{unit}]", row=lower, col=1)
    along = "time in the period [s]" if found.base_frequency else "time [s]"
    figure.update_xaxes(range=_moving(found))
    figure.update_xaxes(title_text=along, row=2 * robot.n, col=1)
    return themed(figure, height=130 + _JOINT * robot.n)


def _moving(found: Beside) -> list[float]:
    """Return the stretch of time that is shown at first: all but one in a hundred of the rows that count."""
    t = found.t[found.used.any(axis=1)] if found.used.any() else found.t
    start, end = np.quantile(t, [0.005, 0.995])
    room = 0.02 * (end - start)
    return [max(float(found.t[0]), float(start - room)), min(float(found.t[-1]), float(end + room))]


def _curve(label: str, t: Array, y: Array, colour: str, unit: str, joint: int) -> dict[str, Any]:
    rows = extremes(y)
    # an even grid needs no abscissae
    along = {"x0": t[0], "dx": t[1] - t[0]} if len(rows) == len(t) > 1 else {"x": t[rows].astype(np.float32)}
    look = {"y": y[rows].astype(np.float32), "mode": "lines", "line": {"color": colour, "width": 1.3}}
    return trace(label, joint == 0, f"%{{x:.4g}} s: %{{y:.4g}} {unit}", **along, **look)


def torque_text(besides: Mapping[str, Beside]) -> str:
    """Return what the figure shows: size of torque and residual of every joint, and where the residual is largest."""
    parts = []
    for model, found in besides.items():
        rms = np.sqrt(found.mean_square())
        for joint, name in enumerate(found.robot.joints):
            used = np.flatnonzero(found.used[:, joint])
            if not len(used):
                continue
            peak = int(used[np.argmax(np.abs(found.residual[used, joint]))])
            unit, sigma = found.robot.torque_unit(joint), found.sigma[joint]
            noise = f", noise {sigma:.3g}" if np.isfinite(sigma) else ""
            parts.append(
                f"{name}: torque up to {np.abs(found.measured[:, joint]).max():.3g} {unit}, residual of {model}"
                f" {rms[joint]:.3g} {unit} rms{noise}, at most {abs(found.residual[peak, joint]):.3g} at"
                f" {found.t[peak]:.4g} s"
            )
    return "; ".join(parts) + "."

"""Where a model fails: its mean residual over velocity, position and load, in bins of equally many rows, beside what
noise alone leaves.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from robot_ident.figures.theme import model_colour, plain, themed, trace
from robot_ident.figures.torque_over_time import noise_band
from robot_ident.residuals.beside import Beside
from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Array, Mask

if TYPE_CHECKING:
    from plotly.graph_objects import Figure


@dataclass(frozen=True)
class Binned:
    """Of K bins: the middle of the variable, mean of the residual [Nm], and the standard deviation that noise alone
    gives that mean (nan where unknown).
    """

    middle: Array
    mean: Array
    spread: Array


def binned(
    x: Sequence[Array], y: Sequence[Array], used: Sequence[Mask], variance: Sequence[float], bins: int
) -> Binned:
    """Return the mean of y over x, recordings together; variance: of the noise of an independent row of each."""
    values = np.concatenate([one[u] for one, u in zip(x, used, strict=True)])
    rest = np.concatenate([one[u] for one, u in zip(y, used, strict=True)])
    noise = np.concatenate([np.full(int(u.sum()), v) for u, v in zip(used, variance, strict=True)])
    if not len(values):
        nothing = np.zeros(0)
        return Binned(nothing, nothing, nothing)
    edges = np.unique(np.quantile(values, np.linspace(0.0, 1.0, bins + 1)))
    place = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, max(0, len(edges) - 2))
    count = np.bincount(place, minlength=max(1, len(edges) - 1)).astype(float)
    some = count > 0
    count = count[some]

    def mean(of: Array) -> Array:
        return np.asarray(np.bincount(place, of, len(some))[some] / count)

    return Binned(mean(values), mean(rest), np.sqrt(mean(noise) / count))


_BINS = 24
_ROW = 250  # px of a joint
_SURE = 2.0  # standard deviations of a bin's mean


@dataclass(frozen=True)
class _Variable:
    """A variable of a joint; directed: with a curve for either direction of its motion."""

    name: str
    values: Callable[[Beside, int], Array]
    unit: Callable[[Robot, int], str]
    directed: bool


def _length(robot: Robot, joint: int) -> str:
    return "m" if robot.prismatic[joint] else "rad"


_VARIABLES = (
    _Variable("velocity", lambda b, j: b.dq[:, j], lambda r, j: f"{_length(r, j)}/s", False),
    _Variable("position", lambda b, j: b.q[:, j], _length, True),
    _Variable("load torque", lambda b, j: b.load[:, j], lambda r, j: r.torque_unit(j), True),
)

_SIDES = {
    0: ("", "solid", "circle"),
    1: (", forward", "solid", "triangle-right"),
    -1: (", backward", "dot", "triangle-left"),
}
"""How the curve of a direction is named and drawn."""


def residual_over_figure(besides: Mapping[str, Sequence[Beside]]) -> Figure:
    """Return each joint's mean residual [Nm] over velocity, position and load torque, recordings together.

    besides: by the name of the model, its recordings. Bins hold equally many rows; over position and load either
    direction of motion has its curve, as friction does. The band is what noise alone leaves of a bin's mean, +- 2
    standard deviations.
    """
    from plotly.subplots import make_subplots

    robot = next(iter(besides.values()))[0].robot
    figure = make_subplots(rows=robot.n, cols=len(_VARIABLES), horizontal_spacing=0.07, vertical_spacing=0.25 / robot.n)
    for joint, name in enumerate(robot.joints):
        for column, variable in enumerate(_VARIABLES):
            place, first = {"row": joint + 1, "col": column + 1}, joint == column == 0
            curves = _curves(besides, joint, variable)
            last = list(curves.values())[-1]
            if len(last.middle) and np.all(np.isfinite(last.spread)):
                wide = _SURE * float(np.median(last.spread))
                label = f"noise of a bin's mean, ± {_SURE:g} sigma"
                figure.add_trace(noise_band(last.middle, wide, label, shown=first), **place)
            for (model, side), curve in curves.items():
                number = list(besides).index(model)
                colour = model_colour(number, len(besides))
                shown = joint == 0 and (column == 0 or (column == 1 and side != 0))
                words, dash, symbol = _SIDES[side]
                line = trace(
                    f"{plain(model)}{words}",
                    shown,
                    f"%{{x:.4g}}: %{{y:.3g}} {robot.torque_unit(joint)}",
                    x=curve.middle,
                    y=curve.mean,
                    mode="lines+markers",
                    line={"color": colour, "dash": dash, "width": 1.3},
                    marker={"symbol": symbol, "size": 6, "color": colour},
                )
                figure.add_trace(line, **place)
            figure.update_xaxes(title_text=f"{variable.name} [{variable.unit(robot, joint)}]", **place)
        figure.update_yaxes(title_text=f"{plain(name)}<br>residual [{robot.torque_unit(joint)}]", row=joint + 1, col=1)
    return themed(figure, height=110 + _ROW * robot.n)


def _curves(besides: Mapping[str, Sequence[Beside]], joint: int, variable: _Variable) -> dict[tuple[str, int], Binned]:
    """Return the curves of a panel by model and direction."""
    curves = {}
    for model, found in besides.items():
        x, y = [variable.values(b, joint) for b in found], [b.residual[:, joint] for b in found]
        variance = [float(b.sigma[joint] ** 2 / b.independent) for b in found]
        for side in (1, -1) if variable.directed else (0,):
            used = [b.used[:, joint] & ((b.dq[:, joint] * side > 0.0) if side else True) for b in found]
            curves[model, side] = binned(x, y, used, variance, _BINS)
    return curves


def residual_over_text(besides: Mapping[str, Sequence[Beside]]) -> str:
    """Return what the figure shows: for the last model, where over each variable the mean residual is largest."""
    model, found = list(besides.items())[-1]
    robot = found[0].robot
    parts = []
    for joint, name in enumerate(robot.joints):
        told = []
        for variable in _VARIABLES:
            curves = _curves({model: found}, joint, variable).values()
            curve = max(curves, key=lambda c: float(np.max(np.abs(c.mean), initial=0.0)))
            if len(curve.mean):
                k = int(np.argmax(np.abs(curve.mean)))
                size = f"{curve.mean[k]:.3g} {robot.torque_unit(joint)}"
                told.append(f"{size} at a {variable.name} of {curve.middle[k]:.3g} {variable.unit(robot, joint)}")
        parts.append(f"{name}: {', '.join(told)}")
    return f"Largest mean residual of {model}. {'; '.join(parts)}."

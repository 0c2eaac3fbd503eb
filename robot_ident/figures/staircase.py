"""The staircase of the falling error: residual of every joint from model to model, beside the noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from robot_ident.diagnosis.staircase import Foreseen, Level, Step
from robot_ident.figures.models import plain
from robot_ident.figures.theme import BLUE, VERMILLION, themed

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

_ACROSS = 3  # joints side by side
_ROW = 280  # px


@dataclass(frozen=True)
class _Curve:
    """A line of the staircase: Nm rms over the models, None where there is none."""

    label: str
    rms: Sequence[float | None]
    colour: str
    marked: bool


def staircase_figure(steps: Sequence[Step], foreseen: Foreseen | None = None) -> Figure:
    """Return the residual [Nm rms] of every joint over models in their order, on recordings that were fitted and on
    others, each beside its noise; with open markers the step that a diagnosis foresees.
    """
    from plotly.graph_objects import Scatter
    from plotly.subplots import make_subplots

    robot = steps[0].model.robot
    across = min(_ACROSS, robot.n)
    down = -(-robot.n // across)
    names = ["<br>".join(plain(name) for name in _lines(step)) for step in _every(steps, foreseen)]
    symbols = ["circle"] * len(steps) + ["circle-open"] * (len(names) - len(steps))
    figure = make_subplots(rows=down, cols=across, horizontal_spacing=0.4 / across, vertical_spacing=0.3 / down)
    for number, joint in enumerate(robot.joints):
        place = {"row": number // across + 1, "col": number % across + 1}
        unit = robot.torque_unit(number)
        for curve in _curves(steps, foreseen, joint):
            drawn = Scatter(
                x=names,
                y=curve.rms,
                name=curve.label,
                legendgroup=curve.label,
                showlegend=number == 0,
                mode="lines+markers" if curve.marked else "lines",
                line={"shape": "hvh", "dash": "solid" if curve.marked else "dot", "color": curve.colour},
                marker={"size": 9, "symbol": symbols},
                hovertemplate=f"%{{x}}<br>{curve.label}: %{{y:.4g}} {unit} rms<extra>{plain(joint)}</extra>",
            )
            figure.add_trace(drawn, **place)
        figure.update_yaxes(title_text=f"{plain(joint)} [{unit} rms]", **place)
    figure.update_xaxes(tickfont={"size": 11})
    return themed(figure, height=100 + _ROW * down)


def _every(steps: Sequence[Step], foreseen: Foreseen | None) -> list[Step | Foreseen]:
    return [*steps, *([] if foreseen is None else [foreseen])]


def _lines(step: Step | Foreseen) -> list[str]:
    """Return a step's name and what it adds."""
    name = "predicted" if isinstance(step, Foreseen) else step.name
    return [name, *(part for label in step.added for part in f"+ {label}".replace("@", "\n@").split("\n"))]


def _curves(steps: Sequence[Step], foreseen: Foreseen | None, joint: str) -> list[_Curve]:
    """Return the residual's and the noise's line of a joint, of fitted recordings and, where there are, of others."""
    every = _every(steps, foreseen)
    out = []
    for label, kind, colour in (
        ("fitted recordings", [step.training for step in every], BLUE),
        ("unseen motion", [step.validation for step in every], VERMILLION),
    ):
        levels = [levels.get(joint) for levels in kind]
        if any(level is not None for level in levels):
            out.append(_Curve(label, [None if one is None else one.rms for one in levels], colour, True))
            noise = [None if one is None else one.noise for one in levels]
            out.append(_Curve(f"noise of {label}", noise, colour, False))
    return out


def staircase_text(steps: Sequence[Step]) -> str:
    """Return what the figure shows: first and last residual of every joint, and its noise."""
    robot, first, last = steps[0].model.robot, steps[0], steps[-1]
    parts = []
    for number, joint in enumerate(robot.joints):
        unit = robot.torque_unit(number)
        told = [_fall("on the fitted recordings", first.training[joint], last.training[joint], unit, len(steps) > 1)]
        if last.validation:
            told.append(
                _fall("on unseen motion", first.validation[joint], last.validation[joint], unit, len(steps) > 1)
            )
        parts.append(f"{joint}: {', '.join(told)}")
    return f"Residual of {len(steps)} model{'s' if len(steps) > 1 else ''}. {'; '.join(parts)}."


def _fall(where: str, first: Level, last: Level, unit: str, several: bool) -> str:
    size = f"{first.rms:.3g} to {last.rms:.3g}" if several else f"{last.rms:.3g}"
    noise = "" if last.noise is None else f" (noise {last.noise:.3g})"
    return f"{size} {unit} rms {where}{noise}"

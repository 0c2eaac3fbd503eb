"""The error history: every joint's excess over the noise from model to model, down to zero."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from robot_ident.diagnosis.staircase import Foreseen, Level, Step
from robot_ident.figures.models import plain
from robot_ident.figures.theme import BLUE, VERMILLION, themed

if TYPE_CHECKING:
    from plotly.graph_objects import Bar, Figure

_ROW = 130  # px of a joint
_HEADROOM = 1.3  # of the highest bar: its figure stands above it


def staircase_figure(steps: Sequence[Step], foreseen: Foreseen | None = None) -> Figure:
    """Return the excess over noise [Nm rms] of every joint (a row each) over models in their order.

    Bars of recordings that were fitted stand beside those of the validation; hatched: what a diagnosis predicts of the
    next model. Every axis begins at 0 and reaches beyond the noise, so that a small excess looks small. Where the noise
    is unknown a bar is the whole residual, as its label says.
    """
    from plotly.subplots import make_subplots

    robot = steps[0].model.robot
    every: list[Step | Foreseen] = [*steps, *([] if foreseen is None else [foreseen])]
    names = ["<br>".join(plain(name) for name in _lines(step)) for step in every]
    figure = make_subplots(rows=robot.n, cols=1, shared_xaxes=True, vertical_spacing=0.12 / robot.n)
    for number, joint in enumerate(robot.joints):
        place, unit = {"row": number + 1, "col": 1}, robot.torque_unit(number)
        highest = 0.0
        for label, kind, colour in (
            ("fitted recordings", [step.training for step in every], BLUE),
            ("validation", [step.validation for step in every], VERMILLION),
        ):
            levels = [levels.get(joint) for levels in kind]
            if not any(levels):
                continue
            bars = _bars(label, names, levels, colour, unit, len(steps))
            bars.showlegend = number == 0
            figure.add_trace(bars, **place)
            highest = max([highest, *(max(level.excess, level.noise or 0.0) for level in levels if level)])
        top = _HEADROOM * (highest or 1.0)
        figure.update_yaxes(title_text=f"{plain(joint)}<br>[{unit} rms]", range=(0.0, top), nticks=4, **place)
    figure.update_layout(bargap=0.35, bargroupgap=0.08)
    return themed(figure, height=110 + _ROW * robot.n)


def _lines(step: Step | Foreseen) -> list[str]:
    """Return a step's name and what it adds."""
    return ["predicted" if isinstance(step, Foreseen) else step.name, *(f"+ {label}" for label in step.added)]


def _bars(label: str, names: Sequence[str], levels: Sequence[Level | None], colour: str, unit: str, made: int) -> Bar:
    """Return the bars of a joint on one kind of recordings; those after the `made` models are hatched."""
    from plotly.graph_objects import Bar

    known = all(level is None or level.noise is not None for level in levels)
    name = label if known else f"{label} (noise unknown: residual)"
    return Bar(
        x=names,
        y=[None if level is None else level.excess for level in levels],
        text=["" if level is None else _short(level.excess) for level in levels],
        textposition="outside",
        cliponaxis=False,
        name=name,
        legendgroup=label,
        marker={"color": colour, "pattern": {"shape": ["" if k < made else "/" for k in range(len(levels))]}},
        customdata=["" if level is None else _total(level, unit) for level in levels],
        hovertemplate=f"%{{x}}<br>{name}: %{{y:.3g}} {unit} rms<br>%{{customdata}}<extra></extra>",
    )


def _short(value: float) -> str:
    return f"{value:.3g}" if value >= 1.0 else f"{value:.1g}"


def _total(level: Level, unit: str) -> str:
    noise = "" if level.noise is None else f", noise {level.noise:.3g} {unit} rms"
    return f"residual {level.rms:.3g}{noise}"


def staircase_text(steps: Sequence[Step]) -> str:
    """Return what the figure shows: first and last excess of every joint, with its residual and its noise."""
    robot, first, last = steps[0].model.robot, steps[0], steps[-1]
    parts = []
    for number, joint in enumerate(robot.joints):
        unit = robot.torque_unit(number)
        told = [
            f"{where} {_fall(before[joint], after[joint], unit, len(steps) > 1)}"
            for where, before, after in _kinds(first, last)
        ]
        parts.append(f"{joint}: {', '.join(told)}")
    return f"Excess over noise of {len(steps)} model{'s' if len(steps) > 1 else ''}. {'; '.join(parts)}."


def _kinds(first: Step, last: Step) -> list[tuple[str, Mapping[str, Level], Mapping[str, Level]]]:
    kinds = [("fitted recordings", first.training, last.training)]
    return [*kinds, ("validation", first.validation, last.validation)] if last.validation else kinds


def _fall(first: Level, last: Level, unit: str, several: bool) -> str:
    size = f"{_short(first.excess)} to {_short(last.excess)}" if several else _short(last.excess)
    return f"{size} {unit} rms ({_total(last, unit)})"

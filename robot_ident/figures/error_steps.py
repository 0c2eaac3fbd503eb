"""The error history: every joint's excess over the noise from model to model, down to zero."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from robot_ident.diagnosis.staircase import Foreseen, Level, Step
from robot_ident.figures.theme import BLUE, VERMILLION, plain, themed

if TYPE_CHECKING:
    from plotly.graph_objects import Figure


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
        both = [levels[joint] for step in every for levels in (step.training, step.validation) if joint in levels]
        highest = max(max(level.noise or 0.0, level.excess) for level in both) or 1.0
        for label, kind, colour in (
            ("fitted recordings", [step.training for step in every], BLUE),
            ("validation", [step.validation for step in every], VERMILLION),
        ):
            levels = [levels.get(joint) for levels in kind]
            if not any(levels):
                continue
            known = all(level is None or level.noise is not None for level in levels)
            name = label if known else f"{label} (noise unknown: residual)"
            hatched = ["" if k < len(steps) else "/" for k in range(len(every))]
            figure.add_bar(
                x=names,
                y=[None if level is None else level.excess for level in levels],
                text=["" if level is None else _short(level.excess, highest) for level in levels],
                textposition="outside",
                cliponaxis=False,
                name=name,
                legendgroup=label,
                showlegend=number == 0,
                marker={"color": colour, "pattern": {"shape": hatched}},
                customdata=["" if level is None else _total(level, unit) for level in levels],
                hovertemplate=f"%{{x}}<br>{name}: %{{y:.3g}} {unit} rms<br>%{{customdata}}<extra></extra>",
                **place,
            )
        title, reach = f"{plain(joint)}<br>[{unit} rms]", (0.0, _HEADROOM * highest)
        figure.update_yaxes(title={"text": title, "font": {"size": 13}}, range=reach, nticks=4, **place)
    figure.update_xaxes(showgrid=False)
    return themed(figure, height=120 + _ROW * robot.n, bargap=0.35, bargroupgap=0.08)


def _lines(step: Step | Foreseen) -> list[str]:
    """Return a step's name and what it adds."""
    name = "predicted" if isinstance(step, Foreseen) else step.name
    return [name, *(part for label in step.added for part in f"+ {label}".replace("@", "\n@").split("\n"))]


def _short(value: float, largest: float) -> str:
    """Return a bar's figure, to the third digit of the largest of its axis: all bars of an axis have alike decimals."""
    decimals = max(0, 2 - math.floor(math.log10(largest)))
    return f"{value:.{decimals}f}" if value else "0"


def _total(level: Level, unit: str) -> str:
    noise = "" if level.noise is None else f", noise {level.noise:.3g} {unit} rms"
    return f"residual {level.rms:.3g}{noise}"


def staircase_text(steps: Sequence[Step]) -> str:
    """Return what the figure shows: first and last excess of every joint, with its residual and its noise."""
    robot, first, last = steps[0].model.robot, steps[0], steps[-1]
    kinds = [("fitted recordings", first.training, last.training), ("validation", first.validation, last.validation)]
    parts = []
    for number, joint in enumerate(robot.joints):
        unit = robot.torque_unit(number)
        told = [
            f"{where} {_fall(before[joint], after[joint], unit, len(steps) > 1)}"
            for where, before, after in kinds
            if after
        ]
        parts.append(f"{joint}: {', '.join(told)}")
    return f"Excess over noise of {len(steps)} model{'s' if len(steps) > 1 else ''}. {'; '.join(parts)}."


def _fall(first: Level, last: Level, unit: str, several: bool) -> str:
    largest = max(first.excess, last.excess, last.noise or 0.0) or 1.0
    size = _short(last.excess, largest)
    size = f"{_short(first.excess, largest)} to {size}" if several else size
    return f"{size} {unit} rms ({_total(last, unit)})"

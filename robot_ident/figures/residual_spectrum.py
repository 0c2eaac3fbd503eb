"""Where a model fails over frequency: the residual line by line, beside the noise of a line."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from robot_ident.figures.theme import NOISE_LINE, extremes_along, model_colour, plain, themed, trace
from robot_ident.residuals.residual_lines import ResidualLines
from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Array, Mask

if TYPE_CHECKING:
    from plotly.graph_objects import Figure


_ROW = 260  # px of a joint
_HOVER = "%{{x:.4g}} Hz: %{{y:.3g}} {unit} rms"
LINES = 1200
"""Markers of a kind at most, beyond which the extremes of stretches of frequency are drawn."""
_SAME = 1e-3  # by which the base frequencies of two recordings of one motion may differ
_RARE = 1e-3  # of the lines that hold noise alone lie above the dotted line


def residual_lines_figure(lines: Mapping[str, ResidualLines], robot: Robot, count: int = 1) -> Figure:
    """Return each joint's residual [Nm rms] in every line of frequency [Hz].

    lines: by the name of the model. count: recordings whose mean square they are. Lines that the motion itself holds
    are filled markers, all others open ones. Noise: its mean, and the level that one line of noise in a thousand
    exceeds, a line's mean square over its mean being chi-square distributed with 2 count degrees of freedom.
    """
    from plotly.subplots import make_subplots

    figure = make_subplots(rows=robot.n, cols=1, shared_xaxes=True, vertical_spacing=0.12 / robot.n)
    for joint, name in enumerate(robot.joints):
        unit, place = robot.torque_unit(joint), {"row": joint + 1, "col": 1}
        for number, (model, found) in enumerate(lines.items()):
            colour = model_colour(number, len(lines))
            for kind, rows, filled in (("excited lines", found.excited, True), ("other lines", ~found.excited, False)):
                if rows.any():
                    label = f"{plain(model)}, {kind}"
                    figure.add_trace(_points(label, found, rows, joint, colour, unit, filled=filled), **place)
        last = list(lines.values())[-1]
        if np.all(np.isfinite(last.noise[:, joint])):
            figure.add_trace(_level("noise", last, last.noise[:, joint], "solid", unit, joint), **place)
            rare = last.noise[:, joint] * _exceeded(count)
            label = f"1 noise line in {1 / _RARE:g} is above"
            figure.add_trace(_level(label, last, rare, "dot", unit, joint), **place)
        figure.update_yaxes(title_text=f"{plain(name)}<br>[{unit} rms a line]", type="log", dtick="D2", **place)
        figure.update_xaxes(type="log", **place)
    figure.update_xaxes(title_text="frequency [Hz]", row=robot.n, col=1)
    return themed(figure, height=120 + _ROW * robot.n)


def together(lines: Sequence[ResidualLines]) -> ResidualLines | None:
    """Return the mean square of several recordings' lines; None where they don't share their frequencies."""
    first = lines[0]
    if any(len(one.frequency) != len(first.frequency) for one in lines):
        return None
    if any(abs(one.width / first.width - 1.0) > _SAME for one in lines):
        return None

    def rms(values: Sequence[Array]) -> Array:
        return np.asarray(np.sqrt(np.mean(np.square(values), axis=0)))

    excited: Mask = np.any([one.excited for one in lines], axis=0)
    return ResidualLines(
        first.frequency,
        rms([one.residual for one in lines]),
        rms([one.noise for one in lines]),
        excited,
        first.width,
        np.mean([one.mean for one in lines], axis=0),
    )


def _exceeded(count: int) -> float:
    """Return the factor over the noise's mean rms that a share _RARE of the lines exceeds."""
    from scipy.special import chdtri

    return float(np.sqrt(chdtri(2 * count, _RARE) / (2 * count)))


def _points(
    label: str, found: ResidualLines, rows: Mask, joint: int, colour: str, unit: str, *, filled: bool
) -> dict[str, Any]:
    x, y = found.frequency[rows], found.residual[rows, joint]
    keep = extremes_along(x, y, LINES)
    marker = {"color": colour, "size": 9 if filled else 4, "symbol": "diamond" if filled else "circle-open"}
    points = {"x": x[keep].astype(np.float32), "y": y[keep].astype(np.float32)}
    return trace(label, joint == 0, _HOVER.format(unit=unit), mode="markers", marker=marker, **points)


def _level(label: str, found: ResidualLines, y: Array, dash: str, unit: str, joint: int) -> dict[str, Any]:
    keep = extremes_along(found.frequency, y, 200)
    line = {"color": NOISE_LINE, "dash": dash, "width": 2}
    points = {"x": found.frequency[keep], "y": y[keep]}
    return trace(label, joint == 0, _HOVER.format(unit=unit), mode="lines", line=line, **points)


def residual_lines_text(lines: Mapping[str, ResidualLines], robot: Robot, count: int = 1) -> str:
    """Return how many lines stand above the noise, and which stands out most, for the last model."""
    model, found = list(lines.items())[-1]
    parts = []
    for joint, name in enumerate(robot.joints):
        y, noise, unit = found.residual[:, joint], found.noise[:, joint], robot.torque_unit(joint)
        k = int(np.argmax(y / noise)) if np.all(noise > 0) else int(np.argmax(y))
        kind = "an excited line" if found.excited[k] else "a line that the motion does not hold"
        told = f"{name}: largest at {found.frequency[k]:.3g} Hz, {kind}, {y[k]:.3g} {unit} rms"
        if np.all(noise > 0):
            above = int(np.sum(y > noise * _exceeded(count)))
            told += f" where noise leaves {noise[k]:.3g}; {above} of {len(y)} lines where noise has one in a thousand"
        parts.append(told)
    return f"Residual of {model} by frequency. {'; '.join(parts)}."

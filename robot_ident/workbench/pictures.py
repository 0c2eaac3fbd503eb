"""The pictures of a step: torque over time, residual over a variable, its lines, the error from step to step, and what
they show in words, for readers who don't see them.

A picture is the plain dictionary that plotly.js draws. Building it from plotly's Python classes, which check every
value, would take most of the time between a click and the picture.
"""

from __future__ import annotations

import base64
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Literal

import numpy as np

from robot_ident.figures.residual_scatter import binned
from robot_ident.figures.theme import (
    BLUE,
    GREEN,
    MEASURED,
    NOISE,
    ORANGE,
    PURPLE,
    SHADES,
    SKY,
    VERMILLION,
    axis_look,
    extremes,
    extremes_along,
    page_look,
    plain,
)
from robot_ident.report.wording import joined, short
from robot_ident.signals.motion import Array, Mask
from robot_ident.workbench.brushing import Condition, symbol_of, values
from robot_ident.workbench.view import CANDIDATE, Overlay, View

Shade = Literal["light", "dark"]
Trace = dict[str, Any]

MODEL: dict[Shade, str] = {"light": BLUE, "dark": SKY}
"""Of the present step; the blue that reads on white is dim on black."""

BRUSH = PURPLE
OVERLAYS = (ORANGE, GREEN)
"""Of what is laid over the residual, in the order in which it was ticked."""


def packed(values: Array) -> dict[str, str]:
    """Return numbers [N] as plotly.js takes them in binary: four bytes each, nan a gap."""
    return {"dtype": "f4", "bdata": base64.b64encode(np.ascontiguousarray(values, dtype="<f4").tobytes()).decode()}


def curve(x: Array, y: Array, name: str, **more: Any) -> Trace:
    """Return a trace over two arrays [N]."""
    return {"type": "scatter", "x": packed(x), "y": packed(y), "name": name, **more}


def band(lower: float, upper: float, axis: str, **more: Any) -> dict[str, Any]:
    """Return a shape that shades all between two values of an axis like `x2` or `y`."""
    along = axis[0]
    across = "y" if along == "x" else "x"
    ends = {f"{along}0": lower, f"{along}1": upper, f"{across}0": 0.0, f"{across}1": 1.0}
    return {"type": "rect", f"{along}ref": axis, f"{across}ref": "paper", "line": {"width": 0}, **ends, **more}


def brushed_bands(conditions: Iterable[Condition], axis: str) -> list[dict[str, Any]]:
    """Return the shapes of brushed regions."""
    return [band(one.lower, one.upper, axis, fillcolor=BRUSH, opacity=0.12) for one in conditions]


def picture(
    traces: Sequence[Trace],
    axes: Mapping[str, Mapping[str, Any]],
    shade: Shade,
    revision: str,
    *,
    shapes: Sequence[Mapping[str, Any]] = (),
    **layout: Any,
) -> dict[str, Any]:
    """Return the picture in the page's look, as high as its place on the page.

    axes: by their name in plotly's layout; a title given as text. revision: as long as it stays, a reader's zoom is
    kept.
    """
    common = {**axis_look(shade), "automargin": False}
    dressed = {
        name: {**common, **axis, "title": {**common["title"], "text": axis.get("title", "")}}
        for name, axis in axes.items()
    }
    look: dict[str, Any] = {
        **page_look(shade),
        **dressed,
        "shapes": list(shapes),
        "uirevision": revision,
        "selectdirection": "h",
        "newselection": {"line": {"color": BRUSH, "width": 1}},
        **layout,
    }
    look["legend"] = {**look["legend"], "itemsizing": "constant"}  # points of a cloud could not be seen there
    return {"data": list(traces), "layout": look}


_UPPER, _LOWER = (0.6, 1.0), (0.0, 0.54)  # of the height: torque above, residual below
_PLACES: dict[str, dict[str, str]] = {"torque": {}, "residual": {"xaxis": "x2", "yaxis": "y2"}}


def over_time(
    view: View,
    joint: int,
    recording: int,
    overlays: Sequence[Overlay],
    inside: Sequence[Mask] | None,
    conditions: Sequence[Condition],
    shade: Shade,
) -> dict[str, Any]:
    """Return the picture; inside [N]: which rows of every recording are brushed, None where nothing is."""
    rows, unit = view.rows[recording], view.unit(joint)
    counts = rows.weight[:, joint] > 0
    measured, residual = rows.measured[:, joint], np.where(counts, view.residual[recording][:, joint], np.nan)
    kept = np.union1d(extremes(residual), extremes(measured))

    def line(y: Array, name: str, colour: str, place: str, width: float = 1.4, dash: str = "solid") -> Trace:
        style = {"color": colour, "width": width, "dash": dash}
        hover = "%{y:.4g} " + unit
        return curve(rows.t[kept], y[kept], name, mode="lines", line=style, hovertemplate=hover, **_PLACES[place])

    traces = [
        line(measured, "measured", MEASURED, "torque", 2.0),
        line(view.predicted[recording][:, joint], "predicted", MODEL[shade], "torque", 1.4, "dash"),
        line(residual, "residual", MODEL[shade], "residual"),
    ]
    for colour, one in zip(OVERLAYS, overlays, strict=False):
        later = np.where(counts, one.residual[recording][:, joint], np.nan)
        traces.append(line(later, f"residual {plain(one.words)}", colour, "residual", 1.6))
    if inside is not None:
        chosen = inside[recording]
        style = {"color": BRUSH, "size": 5}
        more = {"mode": "markers", "marker": style, "hoverinfo": "skip", **_PLACES["residual"]}
        traces.append(curve(rows.t[chosen], residual[chosen], "brushed", **more))
    spans = [one for one in conditions if one.variable == "time" and one.recording in (None, recording)]
    shapes = brushed_bands(spans, "x")
    variance = view.recordings[recording]["noise_variance"][joint]
    if variance is not None:  # 95 % of the residual lies there when it is noise alone
        edge = 1.96 * float(np.sqrt(variance))
        shapes.insert(0, band(-edge, edge, "y2", fillcolor=NOISE, layer="below"))
    along = "time in the period, s" if view.recordings[recording]["periods"] > 1 else "time, s"
    axes: dict[str, dict[str, Any]] = {
        "xaxis": {"anchor": "y", "matches": "x2", "showticklabels": False},
        "yaxis": {"domain": _UPPER, "title": f"torque, {unit}"},
        "xaxis2": {"anchor": "y2", "title": along},
        "yaxis2": {"anchor": "x2", "domain": _LOWER, "title": f"residual, {unit}"},
    }
    revision = f"{view.session.name}-{joint}-{recording}"
    return picture(traces, axes, shade, revision, shapes=shapes, hovermode="x", dragmode="select")


MOST_POINTS = 600  # points of a panel, all recordings together; a browser takes most of its time for them
_BINS = 24
_GAP = 0.025  # of the width, between panels
_FAINT: dict[Shade, float] = {"light": 0.25, "dark": 0.4}  # opacity: points vanish in the dark sooner
_SIDES = ((1, "forward", "solid", "triangle-right"), (-1, "backward", "dot", "triangle-left"))


def scatter(
    view: View,
    joint: int,
    variables: Sequence[str],
    overlays: Sequence[Overlay],
    inside: Sequence[Mask] | None,
    conditions: Sequence[Condition],
    shade: Shade,
) -> dict[str, Any]:
    """Return the picture, a panel a variable: the residual as points, its means by direction of motion as lines.

    Of what is laid over it the means alone. inside [N]: which rows of every recording are brushed, or None.
    """
    seen = view.training
    every = [view.residual[k][:, joint] for k in seen]
    later = [[one.residual[k][:, joint] for k in seen] for one in overlays]
    used = [view.rows[k].weight[:, joint] > 0 for k in seen]
    drawn = [_thinned(r, u, MOST_POINTS // len(seen)) for r, u in zip(every, used, strict=True)]
    speeds = [view.rows[k].dq[:, joint] for k in seen]
    sides = {side: [u & (speed * side > 0.0) for u, speed in zip(used, speeds, strict=True)] for side in (1, -1)}
    traces: list[Trace] = []
    shapes: list[dict[str, Any]] = []
    axes: dict[str, dict[str, Any]] = {}
    width = (1.0 - _GAP * (len(variables) - 1)) / len(variables)
    for column, name in enumerate(variables, 1):
        number, start = "" if column == 1 else str(column), (column - 1) * (width + _GAP)
        place = {"xaxis": f"x{number}", "yaxis": f"y{number}"}
        x = [values(view.rows[k], name, view.loads[k], view.joints, joint) for k in seen]
        traces.append(_cloud(place, x, every, drawn, MODEL[shade], "residual", _FAINT[shade], 3.0))
        if inside is not None:
            chosen = [d & inside[k] for d, k in zip(drawn, seen, strict=True)]
            traces.append(_cloud(place, x, every, chosen, BRUSH, "brushed", 0.9, 4.5))
        traces += _lines(place, x, every, sides, MODEL[shade], "mean")
        for colour, one, residual in zip(OVERLAYS, overlays, later, strict=False):
            traces += _lines(place, x, residual, sides, colour, f"mean {plain(one.words)}")
        named = (name, f"{name} of {view.joints[joint]}")
        shapes += brushed_bands((one for one in conditions if one.variable in named), place["xaxis"])
        symbol, unit = symbol_of(view, joint, name)
        title, domain = f"{symbol}, {unit}", (start, start + width)
        axes[f"xaxis{number}"] = {"anchor": place["yaxis"], "domain": domain, "title": title}
        axes[f"yaxis{number}"] = {"anchor": place["xaxis"], "matches": "y", "showticklabels": column == 1}
    axes["yaxis"] = {"anchor": "x", "title": f"residual, {view.unit(joint)}"}
    revision = f"{view.session.name}-{joint}-{','.join(variables)}"
    return picture(traces, axes, shade, revision, shapes=shapes, dragmode="select", hovermode="closest")


def _thinned(residual: Array, used: Mask, most: int) -> Mask:
    """Return which rows are drawn: some at even distances, as they are spread, and the extremes."""
    drawn = np.zeros(len(residual), dtype=bool)
    drawn[:: max(1, 2 * len(residual) // most)] = True
    drawn[extremes(np.where(used, residual, np.nan), max(2, most // 4))] = True
    return drawn & used


def _cloud(
    place: dict[str, str],
    x: Sequence[Array],
    y: Sequence[Array],
    rows: Sequence[Mask],
    colour: str,
    name: str,
    opacity: float,
    size: float,
) -> Trace:
    return curve(
        np.concatenate([one[chosen] for one, chosen in zip(x, rows, strict=True)]),
        np.concatenate([one[chosen] for one, chosen in zip(y, rows, strict=True)]),
        name,
        legendgroup=name,
        showlegend=place["xaxis"] == "x",
        mode="markers",
        marker={"color": colour, "size": size, "opacity": opacity},
        hovertemplate="%{x:.4g}, %{y:.4g}",
        **place,
    )


def _lines(
    place: dict[str, str],
    x: Sequence[Array],
    residual: Sequence[Array],
    sides: Mapping[int, Sequence[Mask]],
    colour: str,
    name: str,
) -> list[Trace]:
    """Return the means of either direction of motion; sides: the rows that count of each."""
    out = []
    for side, words, dash, symbol in _SIDES:
        found = binned(x, residual, sides[side], [float("nan")] * len(x), _BINS)
        trace = curve(
            found.middle,
            found.mean,
            f"{name}, {words}",
            legendgroup=f"{name}, {words}",
            showlegend=place["xaxis"] == "x" and (colour in MODEL.values() or side > 0),
            mode="lines+markers",
            line={"color": colour, "dash": dash, "width": 2},
            marker={"symbol": symbol, "size": 6},
            hovertemplate="%{x:.4g}: %{y:.3g}",
            **place,
        )
        out.append(trace)
    return out


MOST_MARKERS = 500  # markers of a kind


def spectrum(view: View, joint: int, recording: int, overlays: Sequence[Overlay], shade: Shade) -> dict[str, Any]:
    """Return the residual of one recording in every line of frequency, as the report draws it."""
    found, unit = view.lines[recording], view.unit(joint)

    def points(lines: Sequence[Array], rows: Mask, name: str, colour: str, symbol: str, size: int) -> Trace:
        x, y = found.frequency[rows], lines[recording][rows, joint]
        kept = extremes_along(x, y, MOST_MARKERS)
        style = {"color": colour, "size": size, "symbol": symbol}
        hover = "%{x:.3g} Hz: %{y:.3g} " + unit
        return curve(x[kept], y[kept], name, mode="markers", marker=style, hovertemplate=hover)

    traces, mine = [], view.residual_lines
    if found.excited.any():
        traces.append(points(mine, found.excited, "residual, lines of the motion", MODEL[shade], "diamond", 8))
    other = "residual, other lines" if found.excited.any() else "residual"
    traces.append(points(mine, ~found.excited, other, MODEL[shade], "circle-open", 4))
    for colour, one in zip(OVERLAYS, overlays, strict=False):
        every = np.ones(len(found.frequency), dtype=bool)
        traces.append(points(one.lines, every, plain(one.words), colour, "x-thin-open", 5))
    if np.all(np.isfinite(found.noise[:, joint])):
        style = {"color": SHADES[shade]["text"], "dash": "dot", "width": 1.5}
        hover = "%{y:.3g} " + unit
        noise = found.noise[:, joint]
        traces.append(curve(found.frequency, noise, "noise", mode="lines", line=style, hovertemplate=hover))
    axes: dict[str, dict[str, Any]] = {
        "xaxis": {"type": "log", "dtick": "D2", "title": "frequency, Hz"},
        "yaxis": {"type": "log", "title": f"{unit} rms a line", "dtick": "D2"},
    }
    return picture(traces, axes, shade, f"{view.session.name}-{joint}-{recording}", dragmode="zoom")


_HEADROOM = 1.25  # of the highest error: its figure stands above it, below the legend


def staircase(view: View, joint: int, overlays: Sequence[Overlay], shade: Shade) -> dict[str, Any]:
    """Return the root mean squares along the path of steps, and what candidates would make of them (hollow)."""
    name, unit = view.joints[joint], view.unit(joint)
    path = view.session.path(view.number)
    errors = [View(view.session, number).errors for number in path]
    ahead = [one for one in overlays if one.key.startswith(CANDIDATE)]
    added = [(number, view.session.steps[number].added) for number in path]
    ticks = [_broken(f"+ {label}") if label else f"step {number}:<br>to begin with" for number, label in added]
    ticks += [_broken(one.words) for one in ahead]
    ends = (-0.4, len(ticks) - 0.6)
    traces: list[Trace] = []
    highest = 0.0
    for kind, noise_kind, colour, symbol, above in (
        ("training", "noise", MODEL[shade], "circle", False),
        ("validation", "validation_noise", VERMILLION, "square", True),
    ):
        if errors[-1][kind] is None:
            continue
        done = [float(np.sqrt(one[kind][name])) for one in errors]
        foreseen = [float(np.sqrt(getattr(one, kind)[name])) for one in ahead]
        places = np.arange(len(ticks), dtype=float)
        look: dict[str, Any] = {
            "line": {"color": colour, "width": 2, "shape": "hv"},
            "textposition": "middle left" if above else "middle right",
            "cliponaxis": False,
            "hovertemplate": "%{y:.4g}",
        }
        for x, y, hollow in ((places[: len(path)], done, False), (places[len(path) :], foreseen, True)):
            if not y:
                continue
            points = f"{symbol}-open" if hollow else symbol
            trace = curve(
                x,
                np.array(y),
                f"{kind}, predicted" if hollow else kind,
                mode="markers+text" if hollow else "lines+markers+text",
                marker={"size": 9, "symbol": points, "color": colour, "line": {"width": 2, "color": colour}},
                text=[short(value) for value in y],
                showlegend=not hollow,
                **look,
            )
            traces.append(trace)
        noise = errors[-1][noise_kind][name]
        level = 0.0 if noise is None else float(np.sqrt(noise))
        if noise is not None:
            style = {"color": colour, "dash": "dot", "width": 1.5}
            line = {"mode": "lines", "line": style, "hovertemplate": "%{y:.4g}", "showlegend": not above}
            traces.append(curve(np.array(ends), np.array([level, level]), "noise", **line))
        highest = max(highest, level, *done, *foreseen)
    axes: dict[str, dict[str, Any]] = {
        "xaxis": {"tickvals": list(range(len(ticks))), "ticktext": ticks, "range": ends, "tickangle": 0},
        "yaxis": {"title": f"{plain(name)}, {unit} rms", "range": (0.0, _HEADROOM * (highest or 1.0))},
    }
    revision = f"{view.session.name}-{view.number}-{joint}-{len(ahead)}"
    return picture(traces, axes, shade, revision, dragmode=False, margin={"l": 64, "r": 16, "t": 28, "b": 76})


def _broken(text: str) -> str:
    """Return a name in short lines."""
    return plain(text).replace("with ", "with<br>").replace("@", "<br>@")


def over_time_told(view: View, joint: int, recording: int) -> str:
    """Return the size of torque and residual of a joint along a recording, and when the residual is largest."""
    rows, unit = view.rows[recording], view.unit(joint)
    counts = np.flatnonzero(rows.weight[:, joint] > 0)
    words = f"{view.joints[joint]} in {view.recordings[recording]['name']}: "
    words += f"torque up to {short(float(np.abs(rows.measured[:, joint]).max()))} {unit}"
    if not len(counts):
        return f"{words}; no sample counts."
    residual = view.residual[recording][counts, joint]
    peak = int(np.argmax(np.abs(residual)))
    size, when = short(float(np.sqrt(np.mean(residual**2)))), short(float(rows.t[counts[peak]]))
    return f"{words}, residual {size} {unit} rms, at most {short(abs(float(residual[peak])))} at {when} s."


def scatter_told(view: View, joint: int) -> str:
    """Return where the residual's excess is packed."""
    words = view.comparison["joints"][joint]["worst_in_words"]
    return f"Where the residual of {view.joints[joint]} is large: {'; '.join(words) or 'nowhere in particular'}."


def spectrum_told(view: View, joint: int, recording: int) -> str:
    """Return the largest line of a joint's residual, and its noise."""
    found, y = view.lines[recording], view.residual_lines[recording][:, joint]
    k, unit = int(np.argmax(y)), view.unit(joint)
    noise = float(found.noise[k, joint])
    floor = f", where noise leaves {short(noise)}" if np.isfinite(noise) else ""
    return f"The largest line lies at {short(float(found.frequency[k]))} Hz: {short(float(y[k]))} {unit} rms{floor}."


def staircase_told(view: View, joint: int) -> str:
    """Return the errors of a joint from step to step."""
    name = view.joints[joint]
    errors = [View(view.session, number).errors for number in view.session.path(view.number)]
    parts = [
        f"{kind} {' to '.join(short(float(one[kind][name]) ** 0.5) for one in errors)} {view.unit(joint)} rms"
        for kind in ("training", "validation")
        if errors[-1][kind] is not None
    ]
    return f"{name} from step to step: {joined(parts)}."

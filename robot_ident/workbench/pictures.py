"""The pictures of a step: torque over time, residual over a variable, its lines, the error from step to step, and what
they show in words, for readers who don't see them.

A picture is the plain dictionary that plotly.js draws. Building it from plotly's Python classes, which check every
value, would take most of the time between a click and the picture.
"""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from typing import Any

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
from robot_ident.workbench.brushing import Look, Shade
from robot_ident.workbench.view import CANDIDATE

Trace = dict[str, Any]

MODEL: dict[Shade, str] = {"light": BLUE, "dark": SKY}
"""Of the present step; the blue that reads on white is dim on black."""

BRUSH = PURPLE
OVERLAYS = (ORANGE, GREEN)
"""Of what is laid over the residual, in the order in which it was ticked."""


def curve(x: Array, y: Array, name: str, **more: Any) -> Trace:
    """Return a trace over two arrays [N], each as plotly.js takes it in binary: four bytes a number, nan a gap."""
    packed = [
        {"dtype": "f4", "bdata": base64.b64encode(np.ascontiguousarray(one, dtype="<f4").tobytes()).decode()}
        for one in (x, y)
    ]
    return {"type": "scatter", "x": packed[0], "y": packed[1], "name": name, **more}


def band(lower: float, upper: float, axis: str, **more: Any) -> dict[str, Any]:
    """Return a shape that shades all between two values of an axis like `x2` or `y`: by default a brushed region."""
    along, across = ("x", "y") if axis.startswith("x") else ("y", "x")
    ends = {f"{along}0": lower, f"{along}1": upper, f"{across}0": 0.0, f"{across}1": 1.0}
    look = more or {"fillcolor": BRUSH, "opacity": 0.12}
    return {"type": "rect", f"{along}ref": axis, f"{across}ref": "paper", "line": {"width": 0}, **ends, **look}


def picture(
    traces: Sequence[Trace], axes: Mapping[str, Mapping[str, Any]], look: Look, revision: str, **layout: Any
) -> dict[str, Any]:
    """Return the picture in the page's look, as high as its place on the page.

    axes: by their name in plotly's layout; a title given as text. revision: as long as it and the session stay, a
    reader's zoom is kept.
    """
    common, page = {**axis_look(look.shade), "automargin": False}, page_look(look.shade)
    dressed = {
        name: {**common, **axis, "title": {**common["title"], "text": axis.get("title", "")}}
        for name, axis in axes.items()
    }
    whole = {
        **page,
        **dressed,
        "legend": {**page["legend"], "itemsizing": "constant"},  # points of a cloud could not be seen there
        "shapes": [],
        "uirevision": f"{look.view.session.name}-{revision}",
        "selectdirection": "h",
        "newselection": {"line": {"color": BRUSH, "width": 1}},
        **layout,
    }
    return {"data": list(traces), "layout": whole}


_UPPER, _LOWER = (0.6, 1.0), (0.0, 0.54)  # of the height: torque above, residual below
_RESIDUAL: dict[str, Any] = {"xaxis": "x2", "yaxis": "y2"}


def over_time(look: Look) -> dict[str, Any]:
    """Return torque and residual of one recording over time, with the noise and what is brushed."""
    view, joint, recording, model = look.view, look.joint, look.recording, MODEL[look.shade]
    rows, counts, about = view.rows[recording], look.used(recording), view.recordings[recording]
    measured, residual = rows.measured[:, joint], np.where(counts, view.residual[recording][:, joint], np.nan)
    kept = np.union1d(extremes(residual), extremes(measured))

    def line(y: Array, name: str, colour: str, width: float = 1.4, dash: str = "solid", **place: Any) -> Trace:
        style = {"color": colour, "width": width, "dash": dash}
        hover = "%{y:.4g} " + look.unit
        return curve(rows.t[kept], y[kept], name, mode="lines", line=style, hovertemplate=hover, **place)

    traces = [
        line(measured, "measured", MEASURED, 2.0),
        line(view.predicted[recording][:, joint], "predicted", model, 1.4, "dash"),
        line(residual, "residual", model, **_RESIDUAL),
    ]
    for colour, one in zip(OVERLAYS, look.overlays, strict=False):
        later = np.where(counts, one.residual[recording][:, joint], np.nan)
        traces.append(line(later, f"residual {plain(one.words)}", colour, 1.6, **_RESIDUAL))
    if look.inside is not None:
        chosen = look.inside[recording]
        more = {"mode": "markers", "marker": {"color": BRUSH, "size": 5}, "hoverinfo": "skip", **_RESIDUAL}
        traces.append(curve(rows.t[chosen], residual[chosen], "brushed", **more))
    spans = [one for one in look.conditions if one.variable == "time" and one.recording in (None, recording)]
    shapes = [band(one.lower, one.upper, "x") for one in spans]
    variance = about["noise_variance"][joint]
    if variance is not None:  # 95 % of the residual lies there when it is noise alone
        edge = 1.96 * float(np.sqrt(variance))
        shapes.insert(0, band(-edge, edge, "y2", fillcolor=NOISE, layer="below"))
    axes: dict[str, dict[str, Any]] = {
        "xaxis": {"anchor": "y", "matches": "x2", "showticklabels": False},
        "yaxis": {"domain": _UPPER, "title": f"torque, {look.unit}"},
        "xaxis2": {"anchor": "y2", "title": "time in the period, s" if about["periods"] > 1 else "time, s"},
        "yaxis2": {"anchor": "x2", "domain": _LOWER, "title": f"residual, {look.unit}"},
    }
    return picture(traces, axes, look, f"{joint}-{recording}", shapes=shapes, hovermode="x", dragmode="select")


MOST_POINTS = 600  # points of a panel, all recordings together; a browser takes most of its time for them
_BINS = 24
_GAP = 0.025  # of the width, between panels
_FAINT: dict[Shade, float] = {"light": 0.25, "dark": 0.4}  # opacity: points vanish in the dark sooner
_SIDES = ((1, "forward", "solid", "triangle-right"), (-1, "backward", "dot", "triangle-left"))


def scatter(look: Look) -> dict[str, Any]:
    """Return the residual over velocity, position and a third variable, a panel each: as points, its means by direction
    of motion as lines. Of what is laid over it the means alone.
    """
    view, joint, model = look.view, look.joint, MODEL[look.shade]
    seen, variables = view.training, ("velocity", "position", look.over)
    used, mine = [look.used(k) for k in seen], [view.residual[k][:, joint] for k in seen]
    speeds = [view.rows[k].dq[:, joint] for k in seen]
    drawn = [_thinned(r, u, MOST_POINTS // len(seen)) for r, u in zip(mine, used, strict=True)]
    clouds = [("residual", drawn, {"color": model, "size": 3.0, "opacity": _FAINT[look.shade]})]
    if look.inside is not None:
        chosen = [d & look.inside[k] for d, k in zip(drawn, seen, strict=True)]
        clouds.append(("brushed", chosen, {"color": BRUSH, "size": 4.5, "opacity": 0.9}))
    means = [("mean", mine, model)]
    for colour, one in zip(OVERLAYS, look.overlays, strict=False):
        means.append((f"mean {plain(one.words)}", [one.residual[k][:, joint] for k in seen], colour))
    traces: list[Trace] = []
    shapes: list[dict[str, Any]] = []
    axes: dict[str, dict[str, Any]] = {}
    width = (1.0 - _GAP * (len(variables) - 1)) / len(variables)
    for column, variable in enumerate(variables):
        number, start = str(column + 1) if column else "", column * (width + _GAP)
        place: dict[str, Any] = {"xaxis": f"x{number}", "yaxis": f"y{number}"}
        x = [look.values(k, variable) for k in seen]

        def add(name: str, x: Array, y: Array, hover: str, listed: bool, **more: Any) -> None:
            legend = {"legendgroup": name, "showlegend": listed, "hovertemplate": hover}
            traces.append(curve(x, y, name, **legend, **more))

        for name, rows, marker in clouds:
            along, across = (np.concatenate([one[r] for one, r in zip(of, rows, strict=True)]) for of in (x, mine))
            add(name, along, across, "%{x:.4g}, %{y:.4g}", not column, mode="markers", marker=marker, **place)
        for name, residual, colour in means:
            for side, words, dash, symbol in _SIDES:
                rows = [u & (speed * side > 0.0) for u, speed in zip(used, speeds, strict=True)]
                found = binned(x, residual, rows, [float("nan")] * len(x), _BINS)
                style = {"color": colour, "dash": dash, "width": 2}
                more = {"mode": "lines+markers", "line": style, "marker": {"symbol": symbol, "size": 6}, **place}
                listed = not column and (name == "mean" or side > 0)
                add(f"{name}, {words}", found.middle, found.mean, "%{x:.4g}: %{y:.3g}", listed, **more)
        named = (variable, f"{variable} of {look.name}")
        shapes += [band(one.lower, one.upper, place["xaxis"]) for one in look.conditions if one.variable in named]
        title, domain = ", ".join(look.symbol(variable)), (start, start + width)
        axes[f"xaxis{number}"] = {"anchor": place["yaxis"], "domain": domain, "title": title}
        axes[f"yaxis{number}"] = {"anchor": place["xaxis"], "matches": "y", "showticklabels": column == 0}
    axes["yaxis"] = {"anchor": "x", "title": f"residual, {look.unit}"}
    revision = f"{joint}-{','.join(variables)}"
    return picture(traces, axes, look, revision, shapes=shapes, dragmode="select", hovermode="closest")


def _thinned(residual: Array, used: Mask, most: int) -> Mask:
    """Return which rows are drawn: some at even distances, as they are spread, and the extremes."""
    drawn = np.zeros(len(residual), dtype=bool)
    drawn[:: max(1, 2 * len(residual) // most)] = True
    drawn[extremes(np.where(used, residual, np.nan), max(2, most // 4))] = True
    return drawn & used


MOST_MARKERS = 500  # markers of a kind


def spectrum(look: Look) -> dict[str, Any]:
    """Return the residual of one recording in every line of frequency, as the report draws it."""
    view, joint, recording, model = look.view, look.joint, look.recording, MODEL[look.shade]
    found, mine = view.lines[recording], view.residual_lines[recording]
    motion = [("residual, lines of the motion", mine, found.excited, model, "diamond", 8)]
    rest = "residual, other lines" if found.excited.any() else "residual"
    clouds = [*(motion if found.excited.any() else []), (rest, mine, ~found.excited, model, "circle-open", 4)]
    for colour, one in zip(OVERLAYS, look.overlays, strict=False):
        every = np.ones(len(found.frequency), dtype=bool)
        clouds.append((plain(one.words), one.lines[recording], every, colour, "x-thin-open", 5))
    traces = []
    for name, lines, rows, colour, symbol, size in clouds:
        x, y = found.frequency[rows], lines[rows, joint]
        kept = extremes_along(x, y, MOST_MARKERS)
        marker = {"color": colour, "size": size, "symbol": symbol}
        hover = "%{x:.3g} Hz: %{y:.3g} " + look.unit
        traces.append(curve(x[kept], y[kept], name, mode="markers", marker=marker, hovertemplate=hover))
    noise = found.noise[:, joint]
    if np.all(np.isfinite(noise)):
        style = {"color": SHADES[look.shade]["text"], "dash": "dot", "width": 1.5}
        hover = "%{y:.3g} " + look.unit
        traces.append(curve(found.frequency, noise, "noise", mode="lines", line=style, hovertemplate=hover))
    axes: dict[str, dict[str, Any]] = {
        "xaxis": {"type": "log", "dtick": "D2", "title": "frequency, Hz"},
        "yaxis": {"type": "log", "title": f"{look.unit} rms a line", "dtick": "D2"},
    }
    return picture(traces, axes, look, f"{joint}-{recording}", dragmode="zoom")


_HEADROOM = 1.25  # of the highest error: its figure stands above it, below the legend


def staircase(look: Look) -> dict[str, Any]:
    """Return the root mean squares along the path of steps, and what candidates would make of them (hollow)."""
    view, name = look.view, look.name
    path, errors = view.session.path(view.number), view.errors_so_far
    ahead = [one for one in look.overlays if one.key.startswith(CANDIDATE)]
    added = [(number, view.session.steps[number].added) for number in path]
    ticks = [_broken(f"+ {label}") if label else f"step {number}:<br>to begin with" for number, label in added]
    ticks += [_broken(one.words) for one in ahead]
    places, ends = np.arange(len(ticks), dtype=float), (-0.4, len(ticks) - 0.6)
    traces: list[Trace] = []
    highest = 0.0
    for kind, noise_kind, colour, symbol, side in (
        ("training", "noise", MODEL[look.shade], "circle", "right"),
        ("validation", "validation_noise", VERMILLION, "square", "left"),
    ):
        if errors[-1][kind] is None:
            continue
        done = [float(np.sqrt(one[kind][name])) for one in errors]
        foreseen = [float(np.sqrt(getattr(one, kind)[name])) for one in ahead]
        for x, y, hollow in ((places[: len(path)], done, False), (places[len(path) :], foreseen, True)):
            if not y:
                continue
            points = f"{symbol}-open" if hollow else symbol
            trace = curve(
                x,
                np.array(y),
                f"{kind}, predicted" if hollow else kind,
                mode="markers+text" if hollow else "lines+markers+text",
                line={"color": colour, "width": 2, "shape": "hv"},
                marker={"size": 9, "symbol": points, "color": colour, "line": {"width": 2, "color": colour}},
                text=[short(value) for value in y],
                textposition=f"middle {side}",
                showlegend=not hollow,
                cliponaxis=False,
                hovertemplate="%{y:.4g}",
            )
            traces.append(trace)
        noise = errors[-1][noise_kind][name]
        level = 0.0 if noise is None else float(np.sqrt(noise))
        if noise is not None:
            style = {"color": colour, "dash": "dot", "width": 1.5}
            line = {"mode": "lines", "line": style, "hovertemplate": "%{y:.4g}", "showlegend": kind == "training"}
            traces.append(curve(np.array(ends), np.array([level, level]), "noise", **line))
        highest = max(highest, level, *done, *foreseen)
    axes: dict[str, dict[str, Any]] = {
        "xaxis": {"tickvals": list(range(len(ticks))), "ticktext": ticks, "range": ends, "tickangle": 0},
        "yaxis": {"title": f"{plain(name)}, {look.unit} rms", "range": (0.0, _HEADROOM * (highest or 1.0))},
    }
    margin = {"l": 64, "r": 16, "t": 28, "b": 76}
    revision = f"{view.number}-{look.joint}-{len(ahead)}"
    return picture(traces, axes, look, revision, dragmode=False, margin=margin)


def _broken(text: str) -> str:
    """Return a name in short lines."""
    return plain(text).replace("with ", "with<br>").replace("@", "<br>@")


def over_time_told(look: Look) -> str:
    """Return the size of torque and residual of a joint along a recording, and when the residual is largest."""
    rows, counts = look.view.rows[look.recording], np.flatnonzero(look.used(look.recording))
    words = f"{look.name} in {look.view.recordings[look.recording]['name']}: "
    words += f"torque up to {short(float(np.abs(rows.measured[:, look.joint]).max()))} {look.unit}"
    if not len(counts):
        return f"{words}; no sample counts."
    residual = look.view.residual[look.recording][counts, look.joint]
    peak = int(np.argmax(np.abs(residual)))
    size, when = short(float(np.sqrt(np.mean(residual**2)))), short(float(rows.t[counts[peak]]))
    return f"{words}, residual {size} {look.unit} rms, at most {short(abs(float(residual[peak])))} at {when} s."


def scatter_told(look: Look) -> str:
    """Return where the residual's excess is packed."""
    words = look.view.comparison["joints"][look.joint]["worst_in_words"]
    return f"Where the residual of {look.name} is large: {'; '.join(words) or 'nowhere in particular'}."


def spectrum_told(look: Look) -> str:
    """Return the largest line of a joint's residual, and its noise."""
    found, y = look.view.lines[look.recording], look.view.residual_lines[look.recording][:, look.joint]
    k = int(np.argmax(y))
    noise = float(found.noise[k, look.joint])
    floor = f", where noise leaves {short(noise)}" if np.isfinite(noise) else ""
    return (
        f"The largest line lies at {short(float(found.frequency[k]))} Hz: {short(float(y[k]))} {look.unit} rms{floor}."
    )


def staircase_told(look: Look) -> str:
    """Return the errors of a joint from step to step."""
    errors = look.view.errors_so_far
    parts = [
        f"{kind} {' to '.join(short(float(one[kind][look.name]) ** 0.5) for one in errors)} {look.unit} rms"
        for kind in ("training", "validation")
        if errors[-1][kind] is not None
    ]
    return f"{look.name} from step to step: {joined(parts)}."

"""Draws docs/images/first_page_light.png and _dark.png: what the robot of `robot_ident demo` leaves over, the effect
that diagnose selects, and the excess over noise that falls to zero.

`readme_picture.py [FOLDER]` writes elsewhere. Needs Chromium and playwright. The seeds are fixed.
"""

from __future__ import annotations

import shutil
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np

from robot_ident.cli.demo import HIDDEN, ROBOT
from robot_ident.design.design import design
from robot_ident.diagnosis.diagnose import diagnose
from robot_ident.estimation.identify import estimate
from robot_ident.figures.residual_scatter import binned
from robot_ident.figures.theme import BLUE, FONT, GREY, NOISE, SHADES, SKY, VERMILLION, themed
from robot_ident.model.structure import Structure
from robot_ident.recording import process
from robot_ident.residuals.beside import beside
from robot_ident.residuals.comparison import compare
from robot_ident.robot import load_robot
from robot_ident.testbed.phenomena import plant_physics
from robot_ident.testbed.simulation import Play
from robot_ident.workflow.inputs import Inputs
from robot_ident.workflow.steps import add_until_adequate

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

    from robot_ident.model.model import Model
    from robot_ident.recording.measurement import Measurement
    from robot_ident.workflow.steps import Additions

WIDTH, HEIGHT = 1400, 500  # px
JOINT, EFFECT = 2, "stribeck@joint_3"  # on the left
PAGE = {"light": "#ffffff", "dark": "#0d1117"}
NAMES = {"load_friction": "load<br>friction", "torque_ripple": "ripple", "stribeck": "Stribeck"}


def measured() -> list[Measurement]:
    """Return two designed motions of the demo's robot, averaged over 10 periods."""
    robot = load_robot(ROBOT)
    physics = plant_physics(robot, list(HIDDEN))
    series = [design(robot, seed=seed, starts=4).excitation.series for seed in (0, 1)]
    return [
        process(Play.of(robot, physics, one).record(10, seed=seed), robot) for seed, one in enumerate(series, start=1)
    ]


def found(recordings: list[Measurement]) -> Additions:
    """Return what adding the effects that diagnose selects comes to."""
    model = estimate(recordings, Structure.build(load_robot(ROBOT)))
    first = diagnose(recordings, model.structure)
    inputs = Inputs((model,), ("model.yaml",), (), tuple(recordings), ())
    return add_until_adequate(first, inputs)


def before(added: Additions) -> Model:
    """Return the model to which the effect of the left panel is added."""
    last = [step.model.structure.effects[-1].label for step in added.steps]
    return added.steps[last.index(EFFECT) - 1].model


def residual(figure: Figure, recordings: list[Measurement], model: Model) -> None:
    """Draw a joint's residual over velocity, its mean in bins and the band of the noise."""
    from plotly.graph_objects import Scatter

    rows = [beside(model, one) for one in recordings]
    used = [one.used[:, JOINT] for one in rows]
    x, y = [one.dq[:, JOINT] for one in rows], [one.residual[:, JOINT] for one in rows]
    mean = binned(x, y, used, [float(one.sigma[JOINT] ** 2) for one in rows], 40)
    wide, ends = 2.0 * float(np.mean([one.sigma[JOINT] for one in rows])), [-1.45, 1.45]
    band = {"x": [*ends, *ends[::-1]], "y": [-wide, -wide, wide, wide], "fill": "toself", "fillcolor": NOISE}
    figure.add_trace(Scatter(**band, mode="lines", line={"width": 0}), 1, 1)
    some = slice(None, None, 3)
    dots = {"color": GREY, "size": 4, "opacity": 0.45}
    every = [np.concatenate([one[u] for one, u in zip(of, used, strict=True)])[some] for of in (x, y)]
    figure.add_trace(Scatter(x=every[0], y=every[1], mode="markers", marker=dots), 1, 1)
    line = {"color": VERMILLION, "width": 4}
    figure.add_trace(Scatter(x=mean.middle, y=mean.mean, mode="lines", line=line), 1, 1)


def history(figure: Figure, recordings: list[Measurement], added: Additions) -> None:
    """Draw the excess over noise of every joint from step to step."""
    from plotly.graph_objects import Bar

    names = ["model of<br>the paper"]
    names += [f"+ {NAMES[step.model.structure.effects[-1].name]}" for step in added.steps[1:]]
    every = [compare(step.model, recordings).joints for step in added.steps]
    for number, colour in enumerate((BLUE, SKY, VERMILLION)):
        excess = [joints[number].excess for joints in every]
        label = every[0][number].name.replace("_", " ")
        figure.add_trace(Bar(x=names, y=excess, name=label, marker={"color": colour}, showlegend=True), 1, 2)


def picture(recordings: list[Measurement], added: Additions, shade: str) -> Figure:
    """Return the picture on a light or a dark page."""
    from plotly.subplots import make_subplots

    finding = next(one for said in added.said for one in said.missing if one.label == EFFECT)
    figure = make_subplots(1, 2, column_widths=[0.42, 0.58], horizontal_spacing=0.27)
    residual(figure, recordings, before(added))
    history(figure, recordings, added)
    text = SHADES[shade]["text"]
    themed(figure, height=HEIGHT, width=WIDTH, showlegend=True, bargap=0.25, bargroupgap=0.05)
    figure.update_traces(showlegend=False, selector={"type": "scatter"})
    figure.update_layout(
        paper_bgcolor=PAGE[shade],
        plot_bgcolor=PAGE[shade],
        font={"size": 22, "family": FONT, "color": text},
        margin={"l": 92, "r": 20, "t": 84, "b": 84},
        legend={"orientation": "v", "x": 1.0, "xanchor": "right", "y": 1.0, "yanchor": "top", "font": {"size": 22}},
    )
    lines = {"gridcolor": SHADES[shade]["grid"], "linecolor": SHADES[shade]["axis"], "tickfont": {"size": 20}}
    figure.update_xaxes(**lines, showgrid=False)
    figure.update_yaxes(**lines)
    figure.update_xaxes(title={"text": "velocity [rad/s]"}, range=(-1.5, 1.5), dtick=1.0, tick0=0.0, col=1)
    figure.update_yaxes(title={"text": "Nm"}, range=(-33, 33), dtick=10, col=1)
    figure.update_yaxes(title={"text": "Nm rms"}, rangemode="tozero", col=2)
    notes(figure, shade, f"{100 * finding.explained:.0f} %")
    return figure


def notes(figure: Figure, shade: str, explained: str) -> None:
    """Write the titles, the effect that is selected with its evidence, and the arrow."""
    text = SHADES[shade]["text"]
    left, right = figure.layout.xaxis.domain, figure.layout.xaxis2.domain
    middle = (left[1] + right[0]) / 2 - 0.03

    def note(words: str, x: float, y: float, **more: Any) -> None:
        look = {"xref": "paper", "yref": "paper", "showarrow": False, "font": {"size": 24, "color": text}}
        figure.add_annotation(text=words, x=x, y=y, **(look | more))

    title = {"xanchor": "left", "yanchor": "bottom", "font": {"size": 26, "color": text}}
    note("<b>Residual of joint 3</b>", left[0], 1.06, **title)
    note("<b>Excess over noise</b>", right[0], 1.06, **title)
    note("noise", 1.43, -7.4, xref="x", yref="y", xanchor="right", yanchor="top", font={"size": 20, "color": text})
    note("selected by diagnose:", middle, 0.84, font={"size": 20, "color": text})
    note("<b>Stribeck friction<br>on joint 3</b>", middle, 0.66, font={"size": 26, "color": VERMILLION})
    note(f"explains {explained}<br>of the excess", middle, 0.42)
    arrow = {"showarrow": True, "arrowhead": 2, "arrowsize": 1.2, "arrowwidth": 4, "arrowcolor": VERMILLION}
    note("", middle + 0.07, 0.2, ax=-170, ay=0, **arrow)


def draw(folder: Path) -> None:
    """Write both pictures."""
    from playwright.sync_api import sync_playwright

    chromium = next(path for name in ("chromium", "chromium-browser", "google-chrome") if (path := shutil.which(name)))
    recordings = measured()
    added = found(recordings)
    with sync_playwright() as playwright, TemporaryDirectory() as pages:
        browser = playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        for shade in PAGE:
            html = Path(pages) / f"{shade}.html"
            picture(recordings, added, shade).write_html(html, config={"displayModeBar": False})
            html.write_text(html.read_text().replace("<body>", '<body style="margin:0">'))
            page = browser.new_page(viewport={"width": WIDTH, "height": HEIGHT})
            page.goto(html.as_uri())
            page.locator(".main-svg").first.wait_for()
            page.screenshot(path=folder / f"first_page_{shade}.png")
        browser.close()


if __name__ == "__main__":
    draw(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).resolve().parents[1] / "docs" / "images")

"""The pages: where things stand on them. What they show is filled in by `callbacks` and `drawing`."""

from __future__ import annotations

from typing import Any

from dash import dcc, html

from robot_ident.figures.theme import private
from robot_ident.workbench.allowed_paths import BUILT_IN, below, describes_robot, is_recording
from robot_ident.workbench.controller import Desk
from robot_ident.workbench.panels import action

UNDO, REDO = ({"do": deed, "label": "", "at": ""} for deed in ("undo", "redo"))


def shell() -> html.Div:
    """Return what every page has: its address, the look, and a place for what belongs to the address."""
    backwards = [
        html.Button("Undo", id=UNDO, disabled=True, title="look at the step before; nothing is lost"),
        html.Button("Redo", id=REDO, disabled=True, title="go forward again"),
    ]
    return html.Div(
        [
            dcc.Location(id="address", refresh=False),
            *(dcc.Store(id=name) for name in ("shade", "stand", "drawn", "joint")),
            dcc.Store(id="recording", data=0),
            *(dcc.Store(id=name, data=[]) for name in ("overlays", "brush")),
            *(dcc.Store(id=name) for name in ("focus", "task", "running", "pressed", "brushing")),
            html.Header(
                [
                    html.H1([dcc.Link("robot_ident workbench", href="/")]),
                    html.Span(id="opened"),
                    html.Span(backwards, id="backwards"),
                    html.Button("Light or dark", id="look", title="switch between a light and a dark page"),
                ]
            ),
            html.Main([html.Div(id="page"), html.Div(_session(), id="session", hidden=True)]),
        ],
        id="shell",
    )


def _session() -> list[Any]:
    bar: dict[str, Any] = {"aria-label": "how far it is"}
    work = [html.Progress(id="progress", value="0", max="100", **bar), action("Cancel", "cancel")]
    job = [
        html.Div(work, id="work", hidden=True),
        html.P(id="told"),
        html.Details([html.Summary("This is a fault of the program; details"), html.Pre(id="trace")], id="fault"),
    ]
    guide = [
        html.Ol(id="stages"),
        html.Div(id="next", role="status"),
        html.Div(job, id="job", role="status"),
        html.Div(id="said", role="alert"),
    ]
    bench = [html.Div(_left(), id="left"), html.Div(_right(), id="right")]
    return [html.Section(guide, id="guide"), html.Div(bench, id="bench", hidden=True)]


def _graph(name: str, height: int) -> html.Div:
    """Return the place of a picture, as high from the beginning as it will be, and of what it shows in words."""
    config: Any = private("lasso2d", "autoScale2d", "toImage")
    graph = dcc.Graph(id=name, config=config, responsive=True, style={"height": f"{height}px"})
    return html.Div([graph, html.P(id=f"{name}_told", className="unseen")])


def _part(title: str, *held: Any) -> html.Section:
    return html.Section([html.H2(title), *held])


def _options(words: dict[str, str]) -> list[dict[str, str]]:
    return [{"label": label, "value": value} for value, label in words.items()]


def _left() -> list[Any]:
    thirds = {"load": "load torque", "acceleration": "acceleration", "time_since_reversal": "time since reversal"}
    over = [
        html.Label("third picture over", htmlFor="over"),
        dcc.RadioItems(id="over", options=_options(thirds), value="load", inline=True),
    ]
    return [
        _part("Joints", html.Div(id="joints")),
        _part("Where it fails", html.Div(id="where")),
        _part("Over time", html.Div(id="recordings"), _graph("time", 440), html.Div(id="brushed", role="status")),
        _part("Residual over velocity, position and load", html.Div(over, className="choice"), _graph("scatter", 370)),
        _part("By frequency", _graph("spectrum", 300)),
    ]


def _right() -> list[Any]:
    chosen = dcc.Dropdown(id="other", placeholder="any other effect of the catalogue")
    other = html.Div([chosen, action("Show", "preview", at="list")], className="line")
    return [
        _part("What may be missing", html.Div(id="candidates"), other),
        _part("Side by side", html.Div(id="beside")),
        _part("The error from step to step", _graph("staircase", 300)),
        _part("Steps", html.Div(id="steps")),
        _part("Save", html.Div(_save(), id="save")),
    ]


def _save() -> list[Any]:
    replaced = {"label": "replace what was saved here before", "value": "yes"}

    def line(what: str, text: str, name: str) -> html.Div:
        field = html.Label([f"{text[0].upper()}{text[1:]} as", dcc.Input(id={"name": what}, value=name, type="text")])
        return html.Div([field, action(f"Save the {text}", f"save {what}")], className="line")

    return [
        line("model", "model", "model_workbench.yaml"),
        line("report", "report", "report.html"),
        line("commands", "command lines", "commands.sh"),
        dcc.Checklist(id="replace", options=[replaced], value=[]),
        html.Div(id="saved", role="status"),
        html.P("The same by commands:"),
        html.Pre(id="commands", tabIndex="0"),
    ]


def chooser(desk: Desk) -> list[Any]:
    """Return what can be opened below the folder of the start."""
    from robot_ident.model.model_file import is_model

    root = desk.allowed.root
    outside = [str(path) for path in desk.allowed.outside]
    models = below(root, lambda path: path.suffix in (".yaml", ".yml") and is_model(path))
    models += [path for path in outside if is_model(path)]
    recordings = [*below(root, is_recording), *(path for path in outside if path not in models)]
    sessions, refused = desk.sessions
    held = []
    for one in sessions:
        count, begun = len(one.steps), one.choice.started[:16].replace("T", " ")
        words = f" {one.choice.in_words}; {count} {'step' if count == 1 else 'steps'}; begun {begun}"
        held.append(html.Li([dcc.Link(one.name, href=f"/{one.name}"), html.Span(words)]))
    out: list[Any] = [
        html.P(f"A session can't be opened: {reason}; mend the file, or move its folder away", className="wrong")
        for reason in refused
    ]
    if sessions:
        out.append(_part("Go on with", html.Ul(held)))
    if not recordings:
        words = (
            f"There is no recording below {root}. Start the workbench in the folder that holds yours, or name them:"
            " robot_ident workbench --bag RUN_1 RUN_2 --validation RUN_3"
        )
        return [*out, _part("Begin", html.P(words)), html.Div(id="refused", role="alert")]
    lead = (
        "Choose what each recording is for. Training: models are fitted to it; two or more different motions make a"
        " diagnosis firm. Validation: never fitted, it shows whether a model predicts what it has not seen."
    )
    roles = {"training": "training", "validation": "validation", "none": "not used"}
    rows = []
    for name in recordings:
        role = dcc.RadioItems(id={"role": name}, options=_options(roles), value="none", inline=True)
        seen = [html.Span("…", id={"about": name, "part": "words"}), dcc.Store(id={"about": name, "part": "seen"})]
        rows.append(html.Tr([html.Th(name, scope="row"), html.Td(role), html.Td(seen, className="note")]))
    begun, robots = desk.robot or BUILT_IN[0], [*BUILT_IN, *below(root, describes_robot)]
    given = html.Div(
        [
            html.Label("robot", htmlFor="robot"),
            dcc.Dropdown(id="robot", options=list(dict.fromkeys([begun, *robots])), value=begun, clearable=False),
            html.Label("model to begin with", htmlFor="brought"),
            dcc.Dropdown(id="brought", options=models, placeholder="none: identify the robot's first"),
        ],
        className="given",
    )
    begin = _part(
        "Begin",
        html.P(lead),
        html.P("Looking at what they hold…", id="proposed", role="status"),
        html.Table(rows, className="roles"),
        given,
        html.Button("Open them", id="begin", className="primary"),
        html.Div(id="refused", role="alert"),
    )
    return [*out, begin]

"""The first page: sessions to go on with, and recordings to begin a new one."""

from __future__ import annotations

from typing import Any

from dash import dcc, html

from robot_ident.workbench.desk import Desk
from robot_ident.workbench.paths import models_below, recordings_below, robots_below

ROLES = {"training": "training", "validation": "validation", "none": "not used"}


def chooser(desk: Desk) -> list[Any]:
    """Return what can be opened below the folder of the start."""
    from robot_ident.model.model_file import is_model

    root = desk.allowed.root
    outside = [str(path) for path in desk.allowed.outside]
    models = [*models_below(root), *(path for path in outside if is_model(path))]
    recordings = [*recordings_below(root), *(path for path in outside if path not in models)]
    out: list[Any] = []
    sessions, refused = desk.sessions
    out += [
        html.P(f"A session can't be opened: {reason}; mend the file, or move its folder away", className="wrong")
        for reason in refused
    ]
    if sessions:
        out.append(html.Section([html.H2("Go on with"), html.Ul([_session(one) for one in sessions])]))
    if not recordings:
        words = (
            f"There is no recording below {root}. Start the workbench in the folder that holds yours, or name them:"
            " robot_ident workbench --bag RUN_1 RUN_2 --validation RUN_3"
        )
        return [*out, html.Section([html.H2("Begin"), html.P(words)]), html.Div(id="refused", role="alert")]
    lead = (
        "Choose what each recording is for. Training: models are fitted to it; two or more different motions make a"
        " diagnosis firm. Validation: never fitted, it shows whether a model predicts what it has not seen."
    )
    robots = robots_below(root)
    options = [{"label": words, "value": role} for role, words in ROLES.items()]
    rows = [
        html.Tr(
            [
                html.Th(name, scope="row"),
                html.Td(dcc.RadioItems(id={"role": name}, options=options, value="none", inline=True)),
                html.Td(
                    [
                        html.Span("…", id={"about": name, "part": "words"}),
                        dcc.Store(id={"about": name, "part": "seen"}),
                    ],
                    className="note",
                ),
            ]
        )
        for name in recordings
    ]
    begun = desk.robot or robots[0]
    given = html.Div(
        [
            html.Label("robot", htmlFor="robot"),
            dcc.Dropdown(id="robot", options=list(dict.fromkeys([begun, *robots])), value=begun, clearable=False),
            html.Label("model to begin with", htmlFor="brought"),
            dcc.Dropdown(id="brought", options=models, placeholder="none: identify the robot's first"),
        ],
        className="given",
    )
    begin = html.Button("Open them", id="begin", className="primary")
    return [
        *out,
        html.Section(
            [
                html.H2("Begin"),
                html.P(lead),
                html.P("Looking at what they hold…", id="proposed", role="status"),
                html.Table(rows, className="roles"),
                given,
                begin,
                html.Div(id="refused", role="alert"),
            ]
        ),
    ]


def _session(session: Any) -> html.Li:
    choice = session.choice
    words = f"{', '.join(choice.recordings)}" + (
        f"; validation {', '.join(choice.validation)}" if choice.validation else ""
    )
    count = len(session.steps)
    return html.Li(
        [
            dcc.Link(session.name, href=f"/{session.name}"),
            html.Span(
                f" {words}; {count} {'step' if count == 1 else 'steps'}; begun {choice.started[:16].replace('T', ' ')}"
            ),
        ]
    )

"""The command lines that give the same models."""

from __future__ import annotations

import shlex

from robot_ident.workbench.session import Session


def model_name(session: Session, count: int) -> str:
    """Return the file that holds the model after so many additions."""
    return session.choice.model if count == 0 and session.choice.model else f"model_step_{count}.yaml"


def command_lines(session: Session, number: int) -> list[str]:
    """Return the commands, to be run in the folder of the session's start, that lead to a step's model and report."""
    choice = session.choice
    bags = [shlex.quote(name) for name in choice.recordings]
    unseen = [word for name in choice.validation for word in ("--validation", shlex.quote(name))]
    more = ["--topic", shlex.quote(choice.topic)] if choice.topic else []
    more += [word for path in choice.effects_from for word in ("--effects-from", shlex.quote(path))]
    added = session.added(number)
    models = [shlex.quote(model_name(session, count)) for count in range(len(added) + 1)]
    lines = [["cd", shlex.quote(choice.folder)]]
    if choice.model is None:
        robot = ["--robot", shlex.quote(choice.robot)] if choice.robot else []
        lines.append(["robot_ident", "identify", *bags, *robot, *more, "-o", models[0]])
    lines.append(["robot_ident", "compare", models[0], *bags, *more])
    for count, label in enumerate(added):
        before, after = models[count : count + 2]
        lines.append(["robot_ident", "diagnose", before, *bags, *unseen, *more])
        lines.append(["robot_ident", "add", before, shlex.quote(label), "--bag", *bags, *unseen, *more, "-o", after])
    lines.append(["robot_ident", "report", *models, "--bag", *bags, *unseen, *more, "-o", "report.html"])
    return [" ".join(line) for line in lines]


def script(session: Session, number: int) -> str:
    """Return the commands as a shell script."""
    return "\n".join(["#!/bin/sh", "set -e", *command_lines(session, number), ""])

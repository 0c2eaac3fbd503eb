"""`robot_ident report`."""

from __future__ import annotations

import argparse
import shlex
from pathlib import Path
from typing import Any

from robot_ident.cli.output import Progress, print_json, say, say_written
from robot_ident.errors import InputError
from robot_ident.model.model_file import is_model, read_model
from robot_ident.report.sections import write_report
from robot_ident.report.wording import verdict
from robot_ident.workflow.findings import Findings, gather
from robot_ident.workflow.inputs import read_excitations, read_sources, refuse_repeated


def run(args: argparse.Namespace) -> None:
    """Write one self-contained page on models beside recordings."""
    for path in args.models:
        if not is_model(path):
            raise InputError(f"{path}: not a model; make one by robot_ident identify ... -o model.yaml")
    models = [(path, read_model(path)) for path in args.models]
    excitations = read_excitations(args.trajectory, [model for _, model in models])
    steps = len(args.bag) + len(args.validation) + len(excitations) + min(2, len(models)) + 2
    with Progress("report", steps) as bar:
        done = iter(range(steps))

        def heard(what: str) -> None:
            bar.reach(next(done, steps), what)

        training = read_sources(args.bag, models[0][1], topic=args.topic, heard=heard)
        unseen = read_sources(args.validation, models[0][1], topic=args.topic, heard=heard)
        refuse_repeated(training, unseen)
        command, own = _command(args), args.effects_from
        found = gather(models, training, unseen, excitations, command=command, effects_from=own, heard=heard)
        heard("drawing")
        write_report(args.output, found, force=args.force)
    if args.json:
        print_json(_to_dict(args.output, found))
        return
    say(verdict(found))
    say_written(args.output)


def _command(args: argparse.Namespace) -> str:
    """Return what was asked for, as a command that can be run again."""
    words = ["robot_ident", "report", *args.models, "--bag", *args.bag]
    for name in ("validation", "trajectory", "effects_from"):
        for value in getattr(args, name, None) or []:
            words += [f"--{name.replace('_', '-')}", value]
    words += ["--topic", args.topic] if args.topic else []
    return shlex.join([*words, "-o", args.output])


def _to_dict(path: str, found: Findings) -> dict[str, Any]:
    file = Path(path)
    return {
        "schema": "robot_ident/report/1",
        "path": path,
        "bytes": file.stat().st_size,
        "sentence": verdict(found),
        "verdict": found.diagnosis.verdict,
        **found.to_dict(),
    }

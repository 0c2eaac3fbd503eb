"""`robot_ident recover`."""

from __future__ import annotations

import argparse

from robot_ident.bags import recover
from robot_ident.cli.output import print_json, say


def run(args: argparse.Namespace) -> None:
    """Write what is readable as a whole bag and say what was lost."""
    result = recover(args.bag, args.output, force=args.force)
    if args.json:
        data = {"schema": "robot_ident/recover/1", "path": result.output, "messages": result.messages}
        print_json({**data, "kept": result.kept, "lost": list(result.lost)})
        return
    for loss in result.lost or ("nothing was lost",):
        say(loss)
    say(f"{result.messages} messages written: {args.output}")

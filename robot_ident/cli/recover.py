"""`robot_ident recover`."""

from __future__ import annotations

import argparse

from robot_ident.cli.options import add_json, add_output
from robot_ident.cli.output import print_json, say


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's options."""
    parser.add_argument("bag", metavar="BAG", help="truncated bag")
    add_output(parser, "BAG2", "complete bag to write", required=True)
    add_json(parser)


def run(args: argparse.Namespace) -> int:
    """Write what is readable as a whole bag and say what was lost."""
    from robot_ident.bags import recover

    result = recover(args.bag, args.output, force=args.force)
    if args.json:
        data = {"schema": "robot_ident/recover/1", "path": result.output, "messages": result.messages}
        print_json({**data, "kept": result.kept, "lost": list(result.lost)})
        return 0
    for loss in result.lost or ("nothing was lost",):
        say(loss)
    say(f"{result.messages} messages written: {args.output}")
    return 0

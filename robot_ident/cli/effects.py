"""`robot_ident effects`."""

from __future__ import annotations

import argparse

from robot_ident.cli.output import add_json, print_json, say, table


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's options."""
    parser.add_argument("name", nargs="?", metavar="NAME", help="one effect; all when left out")
    add_json(parser)


def run(args: argparse.Namespace) -> int:
    """Print the catalogue."""
    from robot_ident.effects import CATALOGUE
    from robot_ident.errors import InputError, did_you_mean

    if args.name is not None and args.name not in CATALOGUE:
        raise InputError(f"unknown effect {args.name!r}{did_you_mean(args.name, CATALOGUE)}")
    chosen = [CATALOGUE[args.name]] if args.name else list(CATALOGUE.values())
    if args.json:
        listed = [
            {
                "name": effect.name,
                "meaning": effect.meaning,
                "equation": effect.equation,
                "parameters": [
                    {"name": c.name, "unit": c.unit, "unit_prismatic": c.unit_prismatic} for c in effect.coefficients
                ],
            }
            for effect in chosen
        ]
        print_json({"schema": "robot_ident/effects/1", "effects": listed})
        return 0
    rows = [(e.name, e.equation, ", ".join(f"{c.name} [{c.unit}]" for c in e.coefficients), e.meaning) for e in chosen]
    say(table(("effect", "torque", "parameters", "meaning"), rows))
    return 0

"""`--effects-from FILE.py`: a user's own effects, for every verb that knows effects."""

from __future__ import annotations

import argparse


def add_effects_from(parser: argparse.ArgumentParser) -> None:
    """Add the option."""
    text = "Python file with effects of your own (see examples/my_effects.py)"
    parser.add_argument("--effects-from", action="append", default=[], metavar="FILE.py", help=text)


def register_effects(args: argparse.Namespace) -> None:
    """Add the effects of the files named to the catalogue of this process; call it before anything makes an effect."""
    if args.effects_from:
        from robot_ident.effects import load_effects, register

        for path in args.effects_from:
            register(load_effects(path))

"""`--effect A@j B@k`: several effects after one option, on verbs that take recordings beside it."""

from __future__ import annotations

import argparse
import os
from collections.abc import Sequence
from typing import Any

from robot_ident.cli.output import Options
from robot_ident.errors import InputError


class _Effects(argparse.Action):
    """Takes effects; a recording that follows them is one still."""

    def __call__(
        self,
        parser: argparse.ArgumentParser,
        namespace: argparse.Namespace,
        values: str | Sequence[Any] | None,
        option_string: str | None = None,
    ) -> None:
        words = [values] if isinstance(values, str) else list(values or ())
        bags = [word for word in words[1:] if os.path.exists(word)]
        effects = [*words[:1], *(word for word in words[1:] if word not in bags)]
        setattr(namespace, self.dest, [*getattr(namespace, self.dest), *effects])
        namespace.after_effects = [*namespace.after_effects, *bags]


def add_bags_and_effects(parser: Options, model: Options) -> None:
    """Add the recordings to a parser, and `--effect` to its group of the model."""
    parser.add_argument("bags", nargs="*", metavar="BAG", help="recordings to fit, periodic or not")
    model.add_argument(
        "--effect", action=_Effects, nargs="+", default=[], metavar="NAME@JOINT", help="additional effects in the model"
    )
    parser.set_defaults(after_effects=[])


def bags_of(args: argparse.Namespace) -> list[str]:
    """Return all recordings of a command line; InputError where there is none."""
    bags = [*args.bags, *args.after_effects]
    if not bags:
        raise InputError("the following arguments are required: BAG")
    return bags

"""What no certificate covers: said first, and a failure unless it is accepted."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from robot_ident.cli.output import Options, say
from robot_ident.errors import CheckFailed

if TYPE_CHECKING:
    from robot_ident.excitation.margins import Margins

_OPTION = "--accept-unchecked"


def add_accept_unchecked(parser: Options) -> None:
    """Add `--accept-unchecked`."""
    parser.add_argument(
        _OPTION,
        action="store_true",
        help="exit with 0 although limits or collisions were not checked; the output still lists them",
    )


def say_unchecked(margins: Margins) -> None:
    """Print what was not checked, if anything: the first line of a verb's output."""
    if margins.not_checked:
        say(margins.not_checked)


def refuse_unchecked(args: argparse.Namespace, margins: Margins) -> None:
    """Raise CheckFailed where something was not checked and nobody has accepted that."""
    from robot_ident.excitation.margins import unchecked_refusal

    refusal = unchecked_refusal(margins.unknown, f"give {_OPTION}")
    if refusal and not args.accept_unchecked:
        raise CheckFailed(refusal)

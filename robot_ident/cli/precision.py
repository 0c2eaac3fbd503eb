"""`--precision 5% --parameter p3`: how many periods it takes."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

from robot_ident.cli.output import Options, say, table
from robot_ident.errors import InputError, did_you_mean

if TYPE_CHECKING:
    from robot_ident.excitation.excitation import Excitation
    from robot_ident.excitation.precision import Needed
    from robot_ident.excitation.target import Target
    from robot_ident.signals.motion import Array


@dataclass(frozen=True)
class Precision:
    """The share that was asked for, what each parameter takes, the length [s] of a period (of all motions), and whether
    the values are estimates or what the robot's files say.
    """

    share: float
    needed: tuple[Needed, ...]
    period: float
    estimated: bool

    @property
    def periods(self) -> int | None:
        """Periods that all of them take, None where one can't be said."""
        counts = [one.periods for one in self.needed]
        return max((count for count in counts if count is not None), default=None) if None not in counts else None


def add_precision(parser: Options) -> None:
    """Add the options."""
    parser.add_argument(
        "--precision",
        metavar="P",
        help="also print how many periods bring sigma down to this ratio of the value, e.g. 5%%",
    )
    parser.add_argument(
        "--parameter",
        action="append",
        default=[],
        metavar="NAME",
        help="with --precision: only this parameter (default: all); its value comes from --model or the robot's files",
    )


def check_precision(args: argparse.Namespace, target: Target) -> None:
    """Raise InputError where the options can't be used."""
    if args.precision is not None:
        share_of(args.precision)
    elif args.parameter:
        raise InputError("--parameter goes with --precision, like --precision 5%")
    names = target.structure.names
    for name in args.parameter:
        if name not in names:
            raise InputError(f"--parameter {name!r}{did_you_mean(name, names)}")


def precision(
    args: argparse.Namespace, target: Target, excitations: Sequence[Excitation], prior: Array | None = None
) -> Precision | None:
    """Return how many periods the parameters take, None where --precision isn't given."""
    check_precision(args, target)
    if args.precision is None:
        return None
    import numpy as np

    from robot_ident.excitation.precision import periods_needed

    share = share_of(args.precision)
    names = target.structure.names
    rows = [target.rows(one) / np.sqrt(target.periods) for one in excitations]
    information = np.sum([part.T @ part for part in rows], axis=0)
    values = target.values if target.estimated and target.values is not None else target.structure.true_values()
    units = [parameter.unit for parameter in target.structure.parameters]
    needed = periods_needed(information, values, names, units, share, prior)
    asked = tuple(one for one in needed if one.name in (args.parameter or names))
    return Precision(share, asked, sum(one.period for one in excitations), target.estimated)


def share_of(text: str) -> float:
    """Return the share that `5%`, `5 %` or `0.05` means; InputError unless it is between 0 and 1."""
    word = text.strip()
    try:
        share = float(word[:-1]) / 100.0 if word.endswith("%") else float(word)
    except ValueError:
        share = 0.0
    if not 0.0 < share < 1.0:
        raise InputError(f"--precision {text!r}: a ratio of the value was expected, like 5% or 0.05")
    return share


def precision_json(found: Precision | None) -> dict[str, Any] | None:
    """Return plain values."""
    if found is None:
        return None
    return {
        "share": found.share,
        "periods": found.periods,
        "seconds": None if found.periods is None else found.periods * found.period,
        "estimated": found.estimated,
        "parameters": [asdict(one) for one in found.needed],
    }


def say_precision(found: Precision | None) -> None:
    """Print what each parameter takes, the most demanding first."""
    if found is None:
        return
    most = float("inf")
    order = sorted(found.needed, key=lambda one: -(most if one.periods is None else one.periods))
    rows = [(one.name, one.value, one.sigma, one.unit, _periods(one)) for one in order]
    say(table(("parameter", "value", "sigma of one period", "unit", f"periods for {100 * found.share:g} %"), rows))
    whose = "the model's" if found.estimated else "of the robot's files"
    if found.periods is not None:
        say(f"{found.periods} periods ({found.periods * found.period:.4g} s) for all of these")
    say(f"values are {whose}; sigma from noise alone: model errors do not average out")


def _periods(one: Needed) -> str:
    if one.value == 0.0:
        return "value not known: give --model"
    return "never" if one.periods is None else str(one.periods)

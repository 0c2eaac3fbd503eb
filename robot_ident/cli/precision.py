"""`--precision 5% --parameter p3` of `design` and `check`: how many periods of a motion a precision takes."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from robot_ident.cli.output import table
from robot_ident.design.target import Needed, Target, periods_needed
from robot_ident.errors import InputError, did_you_mean
from robot_ident.signals.motion import Array
from robot_ident.trajectories.excitation import Excitation


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

    @property
    def seconds(self) -> float | None:
        """How long these periods are, None where their number can't be said."""
        return None if self.periods is None else self.periods * self.period

    def to_dict(self) -> dict[str, Any]:
        """Return it as `--json` prints it."""
        kept = {"share": self.share, "periods": self.periods, "seconds": self.seconds, "estimated": self.estimated}
        return {**kept, "parameters": [asdict(one) for one in self.needed]}

    def lines(self) -> list[str]:
        """Return what each parameter takes, the most demanding first."""
        order = sorted(self.needed, key=lambda one: -(float("inf") if one.periods is None else one.periods))
        rows = [(one.name, one.value, one.sigma, one.unit, _periods(one)) for one in order]
        header = ("parameter", "value", "sigma of one period", "unit", f"periods for {100 * self.share:g} %")
        out = [table(header, rows)]
        if self.periods is not None:
            out.append(f"{self.periods} periods ({self.seconds:.4g} s) for all of these")
        whose = "the model's" if self.estimated else "of the robot's files"
        return [*out, f"values are {whose}; sigma from noise alone: model errors do not average out"]


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


def _periods(one: Needed) -> str:
    if one.value == 0.0:
        return "value not known: give --model"
    return "never" if one.periods is None else str(one.periods)

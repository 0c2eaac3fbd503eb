"""`robot_ident design --criterion crlb --iterate`: design, measure and estimate in turn, on the simulated robot."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import TYPE_CHECKING

from robot_ident.cli.design_kinds import design_json, refuse_with
from robot_ident.cli.output import Progress, margin_table, print_json, refuse_unchecked, say, say_unchecked, table
from robot_ident.errors import InputError

if TYPE_CHECKING:
    from robot_ident.robot import Robot
    from robot_ident.testbed.redesign import Redesigned

_NOT_WITH = (
    *("--model", "--prior", "--tell", "--only", "--waypoints", "--symmetric", "--bandwidth", "--bound", "--page"),
    *("--precision", "--joints", "--from", "--trajectories"),
)


def check_iterate(args: argparse.Namespace) -> None:
    """Raise InputError where options of other designs are given."""
    if args.criterion != "crlb":
        raise InputError(
            f"--iterate goes with --criterion crlb, which alone depends on the estimate (given: {args.criterion})"
        )
    refuse_with(args, "--iterate", _NOT_WITH)


def run_iterate(args: argparse.Namespace, robot: Robot, files: Sequence[str]) -> int:
    """Iterate, print the bound from round to round, write the last motion."""
    from robot_ident.design.design import Progress as State
    from robot_ident.testbed.redesign import redesign

    with Progress("design", 1.0) as bar:

        def show(number: int, state: State) -> None:
            done = state.done / state.planned if state.planned else 0.0
            if args.time_limit is not None:
                done = state.seconds / args.time_limit
            bar.reach(min(1.0, done), f"round {number + 1}: bound 10^{state.log10_det_covariance:.2f}")

        found = redesign(
            robot,
            effects=args.effect,
            harmonics=args.harmonics,
            base_frequency=args.base_frequency,
            sample_rate=args.sample_rate,
            starts=args.starts,
            time_limit=args.time_limit,
            seed=args.seed,
            progress=show,
        )
    for file in files:
        found.last.excitation.write(file, force=args.force)
    if args.json:
        last, rounds = found.last, found.to_dict()
        print_json(design_json(files, last, last.parameters, last.margins, last.seconds, last.notes, iterations=rounds))
        refuse_unchecked(args, found.last.margins, files)
        return 0
    say_unchecked(found.last.margins)
    say(table(("motion", "log10 det of the bound", "log10 det of c2", "condition number", "sigma, mean"), _rows(found)))
    say(found.in_words)
    say(margin_table(found.last.margins))
    for file in files:
        say(f"written: {file}")
    refuse_unchecked(args, found.last.margins, files)
    return 0


def _rows(found: Redesigned) -> list[tuple[str, ...]]:
    rows: list[tuple[str, ...]] = []
    for one in found.rounds:
        model = one.model
        rows.append(
            (
                one.excitation.criterion or "given",
                f"{one.log10_det_bound:.2f}",
                f"{model.log10_det_covariance:.2f}",
                f"{model.condition_number:.2f}",
                f"{-100 * one.fall:+.1f} %" if one.fall else "",
            )
        )
    return rows

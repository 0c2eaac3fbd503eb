"""`robot_ident design --waypoints`: a tour of approved moves."""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from typing import TYPE_CHECKING

from robot_ident.cli.design_kinds import design_json, refuse_with
from robot_ident.cli.options import Options, count, option
from robot_ident.cli.output import Progress, margin_table, print_json, refuse_unchecked, say, say_unchecked, tell

if TYPE_CHECKING:
    from robot_ident.design.target import Target


_NOT_WITH = (
    *("--iterate", "--tell", "--trajectories", "--symmetric", "--bandwidth", "--bound", "--page", "--prior"),
    *("--precision", "--joints"),
)


def add_waypoints(parser: Options) -> None:
    """Add the options."""
    option(
        parser,
        "--waypoints",
        "FILE",
        "instead of a Fourier series, plan a repeated tour of moves between the approved poses of a YAML",
    )
    count(parser, "--moves", "K", (2, 200), "maximum number of moves of the tour", 12)
    count(parser, "--repeats", "M", (1, 1000), "repetitions of the tour", 8)


def run_waypoints(args: argparse.Namespace, target: Target, files: Sequence[str]) -> int:
    """Plan a tour, and write it as a point-to-point motion."""
    from robot_ident.design.tours import Waypoints, plan_tour

    refuse_with(args, "--waypoints", _NOT_WITH)
    started = time.monotonic()
    waypoints = Waypoints.read(args.waypoints, target.robot)
    with Progress("tour", 1.0) as bar:
        tour = plan_tour(
            target,
            waypoints,
            length=args.moves,
            repeats=args.repeats,
            sample_rate=args.sample_rate,
            seed=args.seed,
            progress=lambda share: bar.reach(share, ""),
        )
    for file in files:
        tour.motion.write(file, force=args.force)
    notes = [*target.notes]
    if tour.refused:
        words = ", ".join(f"{a} to {b}" for a, b in tour.refused)
        notes.append(f"left out, for they break a limit at every speed: {words}")
    if tour.untold:
        still = f" ({', '.join(tour.resting)} never moves)" if tour.resting else ""
        notes.append(
            f"the approved moves{still} leave undetermined: {', '.join(tour.untold)}; approve poses that differ in more"
            " joints, or more of them"
        )
    values, seconds = tour.evaluation, time.monotonic() - started
    if args.json:
        planned = {
            "poses": list(tour.names),
            "paces": list(tour.paces),
            "repeats": args.repeats,
            "duration": tour.motion.duration,
        }
        names = target.structure.names
        print_json(design_json(files, values, names, tour.margins, seconds, notes, waypoints=planned))
        refuse_unchecked(args, tour.margins)
        return 0
    for note in notes:
        tell(note)
    say_unchecked(tour.margins)
    say(f"{len(tour.paces)} moves, {args.repeats} times, {tour.motion.duration:.4g} s: {' - '.join(tour.names)}")
    say("at " + ", ".join(f"{100 * pace:g} %" for pace in tour.paces) + " of the speed")
    say(
        f"log10 det of the covariance {values.log10_det_covariance:.2f}, condition number"
        f" {values.condition_number:.2f} ({seconds:.0f} s)"
    )
    say(margin_table(tour.margins))
    for file in files:
        say(f"written: {file}")
    refuse_unchecked(args, tour.margins)
    return 0

"""`robot_ident trial --family real`: the base model alone, on recordings with the faults of real ones."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING

from robot_ident.cli.journal import SCHEMA, Journal
from robot_ident.cli.output import print_json, say, table
from robot_ident.cli.trial import PERIODS, STOPPED, run_cases
from robot_ident.errors import InputError

if TYPE_CHECKING:
    from robot_ident.diagnosis.base_trial import BaseOutcome
    from robot_ident.diagnosis.trial import Case
    from robot_ident.robot.robot import Robot


def run_base(args: argparse.Namespace, cases: Sequence[Case], robot: Robot) -> int:
    """Run the cases, print how the chosen base models do beside fixed filters."""
    from robot_ident.diagnosis.base_trial import CLOSE, FILTERS, BaseOutcome, base_summary

    for option, changed in (
        ("--excitation", args.excitation),
        ("--folder", args.folder),
        ("--noise", args.noise != 1.0),
        ("--periods", args.periods != PERIODS),
    ):
        if changed:
            raise InputError(f"{option}: has no effect with --family real, which draws motions and noise itself")
    settings = {"schema": SCHEMA, "robot": robot.name, "family": "real"}
    done = Journal.open(args.cases_file, settings, BaseOutcome.of_dict)
    if not run_cases(partial(_one, robot=robot), cases, done, args):
        return STOPPED
    outcomes = [done.outcomes[case] for case in cases]
    result = base_summary(outcomes)
    if args.json:
        each = [one.to_dict() for one in outcomes]
        print_json({"schema": "robot_ident/trial_real/1", "robot": args.robot, **result, "cases": each})
        return 0
    say(f"validation error relative to the best of {len(FILTERS)} fixed filters with the true offsets and scales:")
    rows = [
        (
            kind["kind"],
            *(_ratio(kind[name]) for name in ("median", "ninetieth_percentile", "worst")),
            f"{kind['as_good']} of {kind['cases']}",
            ", ".join(map(str, kind["exceptions"])) or "-",
        )
        for kind in result["kinds"]
    ]
    say(table(("path", "median", "90 % below", "worst", f"within {CLOSE:g}", "seeds beyond"), rows))
    say()
    for rate in result["rates"]:
        say(
            f"{rate['name']}: {rate['successes']} of {rate['cases']}"
            f" ({100 * rate['share']:.0f} %, {100 * rate['lower']:.0f} to {100 * rate['upper']:.0f})"
        )
    if result["seconds"] is not None:
        say(f"one identification: median {result['seconds']:.1f} s of processor time")
    for seed, why in result["refused"].items():
        say(f"seed {seed}: no model ({why})")
    return 0


def _one(case: Case, robot: Robot) -> BaseOutcome:
    from robot_ident.diagnosis.base_trial import run_base_case

    return run_base_case(case.seed, robot)


def _ratio(value: float | None) -> str:
    return "no model" if value is None else f"{value:.2f}"

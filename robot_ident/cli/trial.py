"""`robot_ident trial`; `--family real`: recordings with the faults of real ones, the base model alone or with several
causes on every joint.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import tempfile
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import Any

from robot_ident.cli.journal import SCHEMA, Journal, Kept
from robot_ident.cli.options import given
from robot_ident.cli.output import Progress, print_json, say, table, tell
from robot_ident.design.design import design
from robot_ident.errors import InputError, RobotIdentError, did_you_mean
from robot_ident.parallel import completed
from robot_ident.robot import load_robot
from robot_ident.robot.robot import Robot
from robot_ident.testbed.base_trial import CLOSE, FILTERS, BaseOutcome, base_summary, run_base_case
from robot_ident.testbed.causes_trial import CausesOutcome, causes_summary, run_causes_case
from robot_ident.testbed.phenomena import values_in_words
from robot_ident.testbed.scenario import KINDS, open_sealed, usual_sizes
from robot_ident.testbed.trial import MEASUREMENT, Case, Outcome, Setting, run_case
from robot_ident.testbed.trial_table import summary
from robot_ident.trajectories.excitation import Excitation

_TRAINING = 3  # motions that are identified and diagnosed; one more is kept unseen
_REAL = ("base", "effects")  # kinds of `--family real`
_ROWS = {
    "named_right": "named right, effect and joint",
    "truth_in_tie_group": "truth among indistinguishable alternatives",
    "wrong_name_outside_tie": "wrong name, not an indistinguishable alternative",
    "false_name_on_null": "effect named although nothing is hidden",
    "unknown_named": "effect named for something that is no effect",
    "pair_found_nothing_else": "pairs: both found, nothing else",
    "same_joint_found_or_tied": "two of one joint: both found, or a set of them that is tied",
    "triple_found_or_tied": "three effects: all found, or a set of them that is tied",
    "wrong_name_among_several": "several effects: wrong name, not an indistinguishable alternative",
    "unexplained_though_known": "several effects: said that none of the known ones accounts for the error",
    "fault_named": "measurement fault named or indistinguishable",
    "wrong_name_for_faint_fault": "wrong name for a fault too faint to be asked for",
    "friction_named_for_fault": "friction named for a measurement fault",
    "named_right_with_background": "named right with three background effects of 30 %",
}


class Stopped(RobotIdentError):
    """A trial that Ctrl-C ended."""

    exit_code = 130


def run(args: argparse.Namespace) -> None:
    """Hide effects, diagnose them, and print how often they were named."""
    if args.open:
        _open(args)
        return
    cases = _cases(args)
    if args.periods < 4:
        raise InputError(f"--periods {args.periods}: at least 4 are needed to estimate the noise")
    if not 0 < args.noise < float("inf"):
        raise InputError(f"--noise {args.noise:g}: must be above 0 and finite")
    if args.workers is not None and args.workers < 1:
        raise InputError(f"--workers {args.workers}: at least 1")
    robot = load_robot(args.robot)
    if args.family == "real":
        told = given(args, "--excitation --folder --noise --periods")
        if told:
            raise InputError(f"{told}: has no effect with --family real, which draws motions and noise itself")
        (run_causes if cases[0].kind == "effects" else run_base)(args, cases, robot)
        return
    motions = _motions(args, robot)
    series = tuple(motion.series for motion in motions)
    setting = Setting(robot, series[:-1], series[-1], args.periods, args.noise)
    outcomes = run_cases(args, cases, partial(run_case, setting=setting), _settings(args, motions), Outcome.of_dict)
    _report(args, outcomes, usual_sizes(robot)[0])


def _open(args: argparse.Namespace) -> None:
    scenario = open_sealed(args.open)
    if args.json:
        print_json({"schema": "robot_ident/answer/1", **scenario.model_dump()})
        return
    say(f"{scenario.kind} in {scenario.robot} (seed {scenario.seed})")
    for effect in scenario.effects:
        say(f"  {values_in_words(effect)}")
    for effect in scenario.background:
        say(f"  in the background: {values_in_words(effect)}")
    if scenario.all_effects:
        say("values are those of the simulated robot's own formulas (robot_ident effects NAME shows them)")
    else:
        say("  nothing is hidden")


def _cases(args: argparse.Namespace) -> list[Case]:
    """Return the cases of `--seeds` and `--kind`."""
    if args.family == "measurement" and args.kind:
        raise InputError(f"--kind {args.kind[0]}: is for --family effects or real")
    known = _REAL if args.family == "real" else tuple(KINDS)
    for kind in args.kind:
        if kind not in known:
            raise InputError(f"--kind {kind!r} is not known to --family {args.family}{did_you_mean(kind, known)}")
    if args.family == "real" and len(set(args.kind)) > 1:
        raise InputError("--kind: --family real takes one, base or effects")
    first, colon, last = args.seeds.partition(":")
    if not (colon and first.isdigit() and last.isdigit() and int(first) < int(last)):
        raise InputError(f"--seeds {args.seeds!r}: A:B with 0 <= A < B was expected, like 0:20")
    kinds = [MEASUREMENT] if args.family == "measurement" else list(dict.fromkeys(args.kind)) or [None]
    return [Case(seed, kind) for kind in kinds for seed in range(int(first), int(last))]


def _motions(args: argparse.Namespace, robot: Robot) -> list[Excitation]:
    """Return the motions: those of `--excitation`, those kept in `--folder`, or new ones."""
    if args.excitation:
        if len(args.excitation) < 2:
            raise InputError("--excitation: two files or more, the last one for validation")
        files = [Path(file) for file in args.excitation]
    else:
        folder = Path(args.folder) if args.folder else Path(tempfile.mkdtemp(prefix="robot_ident_trial_"))
        folder.mkdir(parents=True, exist_ok=True)
        files = [folder / f"{robot.name}_{k}.yaml" for k in range(1, _TRAINING + 2)]
        _design_missing(files, robot)
    motions = [Excitation.read(file) for file in files]
    for motion in motions:
        motion.check_robot(robot)
    return motions


def _design_missing(files: Sequence[Path], robot: Robot) -> None:
    """Design the motions that are not there yet; their number is their seed."""
    if all(file.exists() for file in files):
        return
    tell(f"designing {len(files)} motions in {files[0].parent}")
    with Progress("design", len(files)) as bar:
        for number, file in enumerate(files, 1):
            if not file.exists():
                design(robot, starts=1, seed=number).excitation.write(file)
            bar.reach(number)


def _settings(args: argparse.Namespace, motions: Sequence[Excitation]) -> dict[str, Any]:
    """Return what has to agree for two cases to belong to one trial."""
    content = json.dumps([motion.to_dict() for motion in motions], sort_keys=True)
    digest = hashlib.sha256(content.encode()).hexdigest()[:16]
    return {"robot": motions[0].robot, "noise": args.noise, "periods": args.periods, "motions": digest}


def run_cases(
    args: argparse.Namespace,
    cases: Sequence[Case],
    work: Callable[[Case], Kept],
    settings: dict[str, Any],
    of_dict: Callable[[Mapping[str, Any]], Kept],
) -> list[Kept]:
    """Run what isn't done yet, keep each outcome and return all; Stopped where Ctrl-C ends it.

    settings: what has to agree with the file of finished cases, whose outcomes `of_dict` reads.
    """
    done = Journal.open(args.cases_file, {"schema": SCHEMA, **settings}, of_dict)
    left = [case for case in cases if case not in done.outcomes]
    try:
        with Progress("trial", len(cases)) as bar, closing(completed(work, left, args.workers)) as results:
            for index, outcome in results:
                done.add(left[index], outcome)
                bar.reach(len(cases) - len(left) + sum(case in done.outcomes for case in left))
    except KeyboardInterrupt:
        kept = f"are kept in {args.cases_file}; the same command resumes" if args.cases_file else "are lost"
        raise Stopped(f"stopped; {len(done.outcomes)} finished cases {kept}") from None
    return [done.outcomes[case] for case in cases]


def _report(args: argparse.Namespace, outcomes: Sequence[Outcome], least: float) -> None:
    result = summary(outcomes, least)
    if args.json:
        more = {"robot": args.robot, "noise": args.noise, "periods": args.periods, "least_visible_rms": least}
        _print_json(outcomes, "trial", {**more, **result})
        return
    rows = [
        (_ROWS[r["name"]], _percent(r["share"]), f"{100 * r['lower']:.1f} - {_percent(r['upper'])}", r["cases"])
        for r in result["rates"]
    ]
    say(table(("", "rate", "95 % interval", "cases"), rows))
    if result["error_removed"]:
        removed = result["error_removed"]
        say(
            f"\nexcess error on the validation motion removed by adding the named effects:"
            f" median {_percent(removed['median'])}, 10th percentile {_percent(removed['tenth_percentile'])}"
        )
    if result["not_added"]:
        say(f"{result['not_added']} times the named effects could not be added")
    say(f"one diagnosis: median {result['diagnosis_seconds']['median']:.1f} s of processor time", "")
    hidden = [
        (name, sum(row.values()), ", ".join(f"{said} {count}" for said, count in row.items()))
        for name, row in result["confusion"].items()
    ]
    say(table(("hidden", "cases", "named"), hidden))
    failures = sorted({seed for r in result["rates"] for seed in r["exceptions"]})
    if failures:
        say(f"\nseeds with a failure: {', '.join(map(str, failures))}")


def _print_json(outcomes: Sequence[Kept], name: str, result: dict[str, Any]) -> None:
    print_json({"schema": f"robot_ident/{name}/1", **result, "cases": [outcome.to_dict() for outcome in outcomes]})


def _percent(share: float) -> str:
    return f"{100 * share:.1f} %"


def run_base(args: argparse.Namespace, cases: Sequence[Case], robot: Robot) -> None:
    """Run the cases, print how the chosen base models do beside fixed filters."""
    settings = {"robot": robot.name, "family": "real"}
    outcomes = run_cases(args, cases, partial(run_base_case, robot=robot), settings, BaseOutcome.of_dict)
    result = base_summary(outcomes)
    if args.json:
        _print_json(outcomes, "trial_real", {"robot": args.robot, **result})
        return
    say(f"validation error relative to the best of {len(FILTERS)} fixed filters with the true offsets and scales:")
    rows = [
        (
            kind["kind"],
            *(
                "no model" if kind[name] is None else f"{kind[name]:.2f}"
                for name in ("median", "ninetieth_percentile", "worst")
            ),
            f"{kind['as_good']} of {kind['cases']}",
            ", ".join(map(str, kind["exceptions"])) or "-",
        )
        for kind in result["kinds"]
    ]
    say(table(("path", "median", "90 % below", "worst", f"within {CLOSE:g}", "seeds beyond"), rows), "")
    for rate in result["rates"]:
        say(
            f"{rate['name']}: {rate['successes']} of {rate['cases']}"
            f" ({100 * rate['share']:.0f} %, {100 * rate['lower']:.0f} to {100 * rate['upper']:.0f})"
        )
    if result["seconds"] is not None:
        say(f"one identification: median {result['seconds']:.1f} s of processor time")
    for seed, why in result["refused"].items():
        say(f"seed {seed}: no model ({why})")


def run_causes(args: argparse.Namespace, cases: Sequence[Case], robot: Robot) -> None:
    """Run the cases, print how many names were right and how many causes were found, joint by joint."""
    settings = {"robot": robot.name, "family": "real", "kind": "effects"}
    outcomes = run_cases(args, cases, partial(run_causes_case, robot=robot), settings, CausesOutcome.of_dict)
    result = causes_summary(outcomes)
    if args.json:
        _print_json(outcomes, "trial_real_effects", {"robot": args.robot, **result})
        return
    rows = []
    for rate in result["rates"]:
        interval = f"{100 * rate['lower']:.0f} - {100 * rate['upper']:.0f} %"
        rows.append((rate["kind"], rate["name"], f"{rate['successes']} of {rate['cases']}", interval))
    say(table(("path", "", "counted", "95 % interval"), rows), "")
    for one in result["reliability"]:
        say(
            f"names with a probability of {one['probability']:.3f} on average: {one['right']} of {one['names']} right"
            f" ({100 * one['lower']:.0f} to {100 * one['upper']:.0f} %)"
        )
    removed = result["error_removed"]
    if removed["cases"]:
        say(
            f"error on the unseen path removed by adding what was named: median {_percent(removed['median'])},"
            f" 10th percentile {_percent(removed['tenth_percentile'])}, of {removed['cases']} cases"
        )
    say(f"one diagnosis: median {result['seconds']:.1f} s of processor time")
    for seed, why in result["troubles"].items():
        say(f"seed {seed}: can't be added ({why})")

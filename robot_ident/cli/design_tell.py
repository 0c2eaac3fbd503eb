"""`robot_ident design --tell`: the motion that best tells two effects apart."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from robot_ident.cli.design_kinds import design_json
from robot_ident.cli.output import Progress, margin_table, print_json, refuse_unchecked, say, say_unchecked, tell
from robot_ident.errors import InputError

if TYPE_CHECKING:
    from robot_ident.design.discrimination import Telling
    from robot_ident.design.target import Target
    from robot_ident.signals.motion import Array
    from robot_ident.trajectories.excitation import Excitation


def run_tell(
    args: argparse.Namespace,
    target: Target,
    prior: Array | None,
    deadline: float | None,
    files: Sequence[str],
    finished: Callable[[Excitation], Excitation],
) -> int:
    """Design the motion that tells two effects apart; finished: what makes of it what is written."""
    from robot_ident.design.discrimination import NEEDED, tell_apart

    if args.trajectories > 1 or args.symmetric or args.bandwidth or args.harmonics:
        raise InputError(
            "--tell chooses its motion's form itself: leave out --trajectories, --symmetric, --bandwidth and"
            " --harmonics"
        )
    if args.precision:
        raise InputError("--precision counts periods for a parameter's sigma; leave it out with --tell")
    first, second = args.tell
    with Progress("tell", 1.0) as bar:

        def show(tried: int, planned: int, best: float) -> None:
            bar.reach(min(1.0, tried / planned), f"noncentrality {best:.1f}")

        found = tell_apart(
            target,
            first,
            second,
            base_frequency=args.base_frequency,
            sample_rate=args.sample_rate,
            prior=prior,
            seed=args.seed,
            deadline=float("inf") if deadline is None else deadline,
            progress=show,
        )
    excitation = finished(found.excitation)
    for file in files:
        excitation.write(file, force=args.force)
    if args.json:
        print_json(_tell_json(found, target, files, args.tell))
        refuse_unchecked(args, found.margins)
        return 0
    for note in target.notes:
        tell(note)
    say_unchecked(found.margins)
    state = "sufficient" if found.separable else f"not separable by motion: {NEEDED:g} is needed"
    say(f"{first} vs. {second}: noncentrality {found.noncentrality:.1f}, {state} (a motion of kind: {found.kind})")
    for label, text in found.otherwise.items():
        say(f"  {label}: {text}")
    say(margin_table(found.margins))
    for file in files:
        say(f"written: {file}")
    refuse_unchecked(args, found.margins)
    return 0


def _tell_json(found: Telling, target: Target, files: Sequence[str], labels: Sequence[str]) -> dict[str, Any]:
    from robot_ident.design.discrimination import NEEDED

    told = {
        "effects": list(labels),
        "noncentrality": found.noncentrality,
        "of_each": list(found.of_each),
        "needed": NEEDED,
        "separable": found.separable,
        "motion": found.kind,
        "otherwise": found.otherwise,
    }
    values, names = found.evaluation, found.parameters
    return design_json(files, values, names, found.margins, found.seconds, target.notes, tell=told)

"""The kinds of `robot_ident design`: the motion on which a model is validated (`--validation-motion`), a tour of
approved moves (`--waypoints`), the motion that best tells two effects apart (`--tell`), and design, measurement and
estimate in turn on the simulated robot (`--criterion crlb --iterate`); and what all of them refuse, write and print.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterable, Sequence
from typing import Any, Protocol

import numpy as np

from robot_ident.cli.options import given
from robot_ident.cli.output import (
    Progress,
    margin_table,
    print_json,
    refuse_unchecked,
    say,
    say_unchecked,
    say_written,
    table,
    tell,
)
from robot_ident.design.criteria import Evaluation, evaluate_rows
from robot_ident.design.design import DesignResult
from robot_ident.design.design import Progress as State
from robot_ident.design.discrimination import NEEDED, tell_apart
from robot_ident.design.target import Target
from robot_ident.design.tours import Waypoints, plan_tour
from robot_ident.errors import InputError
from robot_ident.limits.certifier import Margins, certify
from robot_ident.planning.validation_motion import validation_motion
from robot_ident.robot import Robot
from robot_ident.signals.motion import Array
from robot_ident.testbed.redesign import redesign
from robot_ident.trajectories.excitation import Excitation

_NOT_WITH = {
    "--validation-motion": "--waypoints --tell --only --iterate --prior --symmetric --bandwidth --harmonics --starts"
    " --time-limit --bound --page --precision --joints --trajectories",
    "--waypoints": "--iterate --tell --trajectories --symmetric --bandwidth --bound --page --prior --precision"
    " --joints",
    "--iterate": "--model --prior --tell --only --waypoints --symmetric --bandwidth --bound --page --precision --joints"
    " --from --trajectories",
}
"""Options that a kind of design (its own option) would not heed."""


class Writable(Protocol):
    """A motion that can be written."""

    def write(self, path: str, *, force: bool) -> None:
        """Write it to a file."""


def refuse_others(args: argparse.Namespace, kind: str) -> None:
    """Raise InputError where options are given that a kind of design would not heed."""
    told = given(args, _NOT_WITH[kind])
    if told:
        raise InputError(f"{kind} does not go with {told}")


def design_json(
    files: Sequence[str],
    values: Evaluation | DesignResult,
    parameters: Sequence[str],
    margins: Margins,
    seconds: float,
    notes: Sequence[str],
    **kind: Any,
) -> dict[str, Any]:
    """Return the keys of all kinds; `kind` are those that one kind of design fills, null (empty) in the others."""
    own: dict[str, Any] = {"tell": None, "bound": None, "page": None, "held": {}, "waypoints": None, "precision": None}
    own |= dict.fromkeys(("validation", "iterations"))
    assert kind.keys() <= own.keys()
    return {
        "schema": "robot_ident/design/1",
        "files": list(files),
        "log10_det_covariance": values.log10_det_covariance,
        "condition_number": values.condition_number,
        "seconds": seconds,
        "margins": margins.to_json(),
        "not_checked": list(margins.unknown),
        "sigma": dict(zip(parameters, values.sigma.tolist(), strict=True)),
        "notes": list(notes),
        **own,
        **kind,
    }


def write_motions(args: argparse.Namespace, files: Sequence[str], *motions: Writable) -> None:
    """Write the motions, if there are files to write."""
    for file, motion in zip(files, motions, strict=bool(files)):
        motion.write(file, force=args.force)


def finish(
    args: argparse.Namespace,
    files: Sequence[str],
    margins: Margins,
    data: dict[str, Any],
    lines: Iterable[str],
    *,
    notes: Iterable[str] = (),
    checked: bool = False,
) -> None:
    """Print a design: as JSON, or as notes, what was not checked, its lines, margins and files.

    checked: whether the files can be accepted by `robot_ident check` where something was not checked.
    """
    if args.json:
        print_json(data)
    else:
        tell(*notes)
        say_unchecked(margins)
        say("\n".join([*lines, margin_table(margins)]))
        say_written(*files, args.page)
    refuse_unchecked(args, margins, files if checked else ())


def share_done(args: argparse.Namespace, state: State) -> float:
    """Return how far a search has come: of its time if that is limited, else of its plan."""
    if args.time_limit is not None:
        return min(1.0, state.seconds / args.time_limit)
    return min(1.0, state.done / state.planned) if state.planned else 0.0


def run_validation(args: argparse.Namespace, target: Target, files: Sequence[str]) -> None:
    """Draw a certified motion through random points with full stops, and write it (Swevers et al. 1997, section V)."""
    refuse_others(args, "--validation-motion")
    started = time.monotonic()
    motion = validation_motion(target.robot, seed=args.seed)
    margins = certify(motion, target.robot)
    t = np.arange(int(motion.duration * args.sample_rate) + 1) / args.sample_rate
    values = evaluate_rows(target.weighted(motion.reference(t), target.torque_variance))
    write_motions(args, files, motion)
    points, seconds = len(motion.points), time.monotonic() - started
    drawn = {"points": points, "duration": motion.duration}
    data = design_json(files, values, target.structure.names, margins, seconds, target.notes, validation=drawn)
    line = (
        f"{points} random points, {motion.duration:.4g} s: maximum acceleration, then velocity, full stop at each;"
        " it enters no fit (validate, --validation)"
    )
    finish(args, files, margins, data, [line])


def run_waypoints(args: argparse.Namespace, target: Target, files: Sequence[str]) -> None:
    """Plan a tour, and write it as a point-to-point motion."""
    refuse_others(args, "--waypoints")
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
            progress=bar.reach,
        )
    write_motions(args, files, tour.motion)
    notes = [*target.notes]
    if tour.refused:
        words = ", ".join(f"{a} to {b}" for a, b in tour.refused)
        notes.append(f"left out, for they break a limit at every speed: {words}")
    if tour.unidentifiable:
        still = f" ({', '.join(tour.resting)} never moves)" if tour.resting else ""
        notes.append(
            f"the approved moves{still} leave undetermined: {', '.join(tour.unidentifiable)}; approve poses that differ"
            " in more joints, or more of them"
        )
    values, seconds, duration = tour.evaluation, time.monotonic() - started, tour.motion.duration
    planned = {"poses": list(tour.names), "paces": list(tour.paces), "repeats": args.repeats, "duration": duration}
    data = design_json(files, values, target.structure.names, tour.margins, seconds, notes, waypoints=planned)
    lines = [
        f"{len(tour.paces)} moves, {args.repeats} times, {duration:.4g} s: {' - '.join(tour.names)}",
        "at " + ", ".join(f"{100 * pace:g} %" for pace in tour.paces) + " of the speed",
        criteria_line(values, seconds),
    ]
    finish(args, files, tour.margins, data, lines, notes=notes)


def criteria_line(values: Evaluation | DesignResult, seconds: float, whose: str = "") -> str:
    """Return both criteria in words; whose: of which motions and recordings together."""
    return (
        f"log10 det of the covariance{whose} {values.log10_det_covariance:.2f}, condition number"
        f" {values.condition_number:.2f} ({seconds:.0f} s)"
    )


def run_tell(
    args: argparse.Namespace,
    target: Target,
    prior: Array | None,
    deadline: float | None,
    files: Sequence[str],
    finished: Callable[[Excitation], Excitation],
) -> None:
    """Design the motion that tells two effects apart; finished: what makes of it what is written."""
    told = given(args, "--trajectories --symmetric --bandwidth --harmonics")
    if told:
        raise InputError(f"--tell chooses its motion's form itself: leave out {told}")
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
    write_motions(args, files, finished(found.excitation))
    found_apart = {
        "effects": list(args.tell),
        "noncentrality": found.noncentrality,
        "of_each": list(found.of_each),
        "needed": NEEDED,
        "separable": found.separable,
        "motion": found.kind,
        "otherwise": found.otherwise,
    }
    values, names = found.evaluation, found.parameters
    data = design_json(files, values, names, found.margins, found.seconds, target.notes, tell=found_apart)
    least = f", the least of {found.pairs} pairs" if found.pairs > 1 else ""
    state = "sufficient" if found.separable else f"not separable by motion: {NEEDED:g} is needed"
    of = f" (a motion of kind: {found.kind})"
    lines = [
        f"{first} vs. {second}: noncentrality {found.noncentrality:.1f}{least}, {state}{of}",
        *(f"  {label}: {text}" for label, text in found.otherwise.items()),
    ]
    finish(args, files, found.margins, data, lines, notes=target.notes)


def check_iterate(args: argparse.Namespace) -> None:
    """Raise InputError where options of other designs are given."""
    if args.criterion != "crlb":
        raise InputError(
            f"--iterate goes with --criterion crlb, which alone depends on the estimate (given: {args.criterion})"
        )
    refuse_others(args, "--iterate")


def run_iterate(args: argparse.Namespace, robot: Robot, files: Sequence[str]) -> None:
    """Iterate, print the bound from round to round, write the last motion."""
    with Progress("design", 1.0) as bar:

        def show(number: int, state: State) -> None:
            note = f"round {number + 1}: bound 10^{state.log10_det_covariance:.2f}"
            bar.reach(share_done(args, state), note)

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
    last, rounds = found.last, found.to_dict()
    write_motions(args, files, last.excitation)
    data = design_json(files, last, last.parameters, last.margins, last.seconds, last.notes, iterations=rounds)
    rows = [
        (
            one.excitation.criterion or "given",
            f"{one.log10_det_bound:.2f}",
            f"{one.model.log10_det_covariance:.2f}",
            f"{one.model.condition_number:.2f}",
            f"{-100 * one.fall:+.1f} %" if one.fall else "",
        )
        for one in found.rounds
    ]
    header = ("motion", "log10 det of the bound", "log10 det of c2", "condition number", "sigma, mean")
    lines = [table(header, rows), found.in_words]
    finish(args, files, last.margins, data, lines, checked=True)

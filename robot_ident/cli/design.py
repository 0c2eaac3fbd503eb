"""`robot_ident design`: motions from the robot's limits, or within the envelope of what it has run already (`--from
BAG`), how good the best is (`--bound`), and how many periods a precision takes (`--precision 5% --parameter p3`).
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace
from pathlib import Path

from robot_ident.cli.design_kinds import (
    check_iterate,
    criteria_line,
    design_json,
    finish,
    run_iterate,
    run_tell,
    run_validation,
    run_waypoints,
    share_done,
    write_motions,
)
from robot_ident.cli.options import DEFAULT_ROBOT, given
from robot_ident.cli.output import Progress
from robot_ident.cli.precision import check_precision, precision
from robot_ident.cli.values import given_angles
from robot_ident.design.bound import TIME_LIMIT, Bound, Proof, determinant_bound
from robot_ident.design.design import DesignResult, design
from robot_ident.design.design import Progress as State
from robot_ident.design.family import family_of
from robot_ident.design.target import Target, all_but_payload
from robot_ident.errors import InputError
from robot_ident.files import refuse_existing
from robot_ident.model.model import Model
from robot_ident.model.model_file import is_model, read_model
from robot_ident.planning.validation_motion import whole_motion
from robot_ident.report.design_sections import design_sections
from robot_ident.report.page import write_page
from robot_ident.robot import Robot, load_robot
from robot_ident.signals.motion import Array
from robot_ident.trajectories.excitation import Excitation
from robot_ident.workflow.fitting import held_for_design, held_note, within_runs
from robot_ident.workflow.inputs import prior_information

_SHARE = 0.4  # of a time limit that is left for the bound
_EXIT = 0.8  # s that writing, and ending the worker processes, take
_WHOLE = 2.0  # s for the certificate of the whole robot where some joints are held


def run(args: argparse.Namespace) -> None:
    """Design excitations."""
    files = output_files(args.output, args.trajectories)
    for file in files:
        refuse_existing(file, force=args.force)
    if args.tell and (told := given(args, "--bound --page")):
        raise InputError(f"{told} goes with a criterion, not with --tell")
    if args.iterate:
        check_iterate(args)
    band = bandwidth_of(args.bandwidth)
    model, whole = _model_and_robot(args)
    robot, held = held_for_design(whole, args.joints, given_angles(args, whole))
    _check_model(args, model, robot)
    robot = within_runs(args.run_before, robot, whole)
    if args.iterate and not args.validation_motion and not args.waypoints:
        run_iterate(args, robot, files)
        return
    target = _target(args, model, robot)
    if args.validation_motion or args.waypoints:
        (run_validation if args.validation_motion else run_waypoints)(args, target, files)
        return
    check_precision(args, target)
    prior = prior_information(args.prior, target, model, bound=args.criterion == "crlb")
    if args.only:
        prior = all_but_payload(target) + (0.0 if prior is None else prior)
    limit = args.time_limit
    deadline = None if limit is None else process_start() + limit - min(_EXIT + _WHOLE * bool(held), 0.1 * limit)
    if args.tell:

        def finished(excitation: Excitation) -> Excitation:
            return _moved_alone(_with_sources(excitation, args), whole, held)

        run_tell(args, target, prior, deadline, files, finished)
        return
    found = _design(args, robot, target, prior, band, until_bound(args, deadline))
    try:
        found, bound = bounded(args, found, target, prior, deadline)
    except KeyboardInterrupt:  # what was designed is kept, without a bound
        found, bound = replace(found, interrupted=True), None
    found = replace(found, excitations=tuple(_with_sources(one, args) for one in found.excitations))
    write_motions(args, files, *(_moved_alone(one, whole, held) for one in found.excitations))
    needed = precision(args, target, found.excitations, prior)
    if args.page:
        write_design_page(args, found, target, bound)
    kept = None if bound is None else bound.to_json(found.log10_det_covariance)
    more = {"bound": kept, "page": args.page, "held": held, "precision": needed and needed.to_dict()}
    data = design_json(files, found, found.parameters, found.margins, found.seconds, found.notes, **more)
    together = f" of {len(found.excitations)} motions together" if len(found.excitations) > 1 else ""
    beside = ", the earlier recordings included" if args.prior else ""
    lines = [
        criteria_line(found, found.seconds, together + beside),
        *bound_lines(bound, found),
        *(needed.lines() if needed else ()),
    ]
    stopped = ("stopped early: this is the best excitation so far",) if found.interrupted else ()
    notes = (*held_note(whole, held), *found.notes, *stopped)
    finish(args, files, found.margins, data, lines, notes=notes, checked=True)


def until_bound(args: argparse.Namespace, deadline: float | None) -> float | None:
    """Return when the search has to end so that the bound fits into the time limit."""
    if deadline is None or not args.bound:
        return deadline
    return deadline - min(TIME_LIMIT, _SHARE * max(0.0, deadline - time.monotonic()))


def bounded(
    args: argparse.Namespace, found: DesignResult, target: Target, prior: Array | None, deadline: float | None
) -> tuple[DesignResult, Bound | None]:
    """Return the design with the bound in what its files say was achieved."""
    if not args.bound:
        return found, None
    time_limit = TIME_LIMIT if deadline is None else min(TIME_LIMIT, max(1.0, deadline - time.monotonic()))
    started = time.monotonic()
    band = found.excitation.reproduce.get("bandwidth")
    family = family_of(
        args.base_frequency, args.sample_rate, args.harmonics, (band[0], band[1]) if band else None, args.symmetric
    )
    with Progress("bound", 1.0) as bar:

        def show(proof: Proof) -> None:
            done = min(1.0, (time.monotonic() - started) / time_limit)
            bar.reach(done, f"within {(proof.upper - proof.lower) / 2.302585:.2f} decades")

        bound = determinant_bound(
            target, family, trajectories=len(found.excitations), prior=prior, time_limit=time_limit, progress=show
        )
    kept = bound.to_json(found.log10_det_covariance)
    excitations = [replace(one, achieved={**one.achieved, "bound": kept}) for one in found.excitations]
    return replace(found, excitations=tuple(excitations)), bound


def bound_lines(bound: Bound | None, found: DesignResult) -> list[str]:
    """Return the efficiency, what it is measured by, and what the bound rests on."""
    if bound is None:
        return []
    efficiency = bound.efficiency(found.log10_det_covariance)
    count = len(found.excitations)
    none = "no motion within the limits gets" if count == 1 else f"no {count} motions within the limits get"
    return [
        f"D-efficiency at least {100 * efficiency:.0f} %: {none} below"
        f" {bound.log10_det_covariance:.2f} ({bound.seconds:.0f} s)",
        bound.explanation(),
    ]


def write_design_page(args: argparse.Namespace, found: DesignResult, target: Target, bound: Bound | None) -> None:
    """Write the page of `--page`."""
    units = tuple(parameter.unit for parameter in target.structure.parameters)
    first = found.excitation
    series = f"{first.harmonics} harmonics of {first.base_frequency:g} Hz, sampled at {first.sample_rate:g} Hz"
    subtitle = f"{first.criterion}, {series}"
    sections = design_sections(found, target.robot, units, bound)
    write_page(args.page, f"Excitation of {first.robot}", sections, subtitle=subtitle, force=args.force)


def output_files(output: str | None, count: int) -> list[str]:
    """Return the files to write: the one that was asked for, or NAME_1.yaml... for several motions."""
    if output is None:
        return []
    if count == 1:
        return [output]
    path = Path(output)
    if not path.name:
        raise InputError(f"-o {output}: the name of a file was expected")
    return [str(path.with_name(f"{path.stem}_{k}{path.suffix}")) for k in range(1, count + 1)]


def bandwidth_of(text: str | None) -> tuple[float, float] | None:
    """Return (lowest, highest) Hz of `LO:HI`."""
    if text is None:
        return None
    low, separator, high = text.partition(":")
    try:
        return float(low), float(high if separator else "")
    except ValueError:
        raise InputError(f"--bandwidth {text!r}: LO:HI in Hz was expected, like 0.5:2.5") from None


def _model_and_robot(args: argparse.Namespace) -> tuple[Model | None, Robot]:
    """Return the model, if any, and the robot: that of --robot (where a model may stand for both), else the model's."""
    model = read_model(args.model) if args.model else None
    if args.robot is None:
        return model, model.robot if model else load_robot(DEFAULT_ROBOT)
    if is_model(args.robot):
        named = read_model(args.robot)
        return model or named, named.robot
    return model, load_robot(args.robot)


def _check_model(args: argparse.Namespace, model: Model | None, robot: Robot) -> None:
    """Raise InputError where a model is of other joints than those that are to move."""
    if model is None or model.robot.joints == robot.joints:
        return
    if set(model.robot.joints) < set(robot.joints):
        way_out = f"say so: --joints {','.join(model.robot.joints)}"
    else:
        way_out = f"identify --joints {','.join(robot.joints)} makes one of these"
    raise InputError(
        f"{args.model or args.robot}: a model of {', '.join(model.robot.joints)}, not of {', '.join(robot.joints)};"
        f" {way_out}"
    )


def _target(args: argparse.Namespace, model: Model | None, robot: Robot) -> Target:
    return Target.of_robot(robot, args.effect) if model is None else Target.of_model(model, args.effect, robot=robot)


def _design(
    args: argparse.Namespace,
    robot: Robot,
    target: Target,
    prior: Array | None,
    band: tuple[float, float] | None,
    deadline: float | None,
) -> DesignResult:
    with Progress("design", 1.0) as bar:

        def show(state: State) -> None:
            note = f"{state.phase}: det 10^{state.log10_det_covariance:.2f}, condition {state.condition_number:.2f}"
            bar.reach(share_done(args, state), note)

        return design(
            robot,
            criterion=args.criterion,
            harmonics=args.harmonics,
            base_frequency=args.base_frequency,
            sample_rate=args.sample_rate,
            effects=args.effect,
            target=target,
            prior=prior,
            trajectories=args.trajectories,
            symmetric=args.symmetric,
            bandwidth=band,
            starts=args.starts,
            time_limit=args.time_limit,
            deadline=deadline,
            seed=args.seed,
            progress=show,
        )


def _moved_alone(excitation: Excitation, robot: Robot, held: dict[str, float]) -> Excitation:
    """Return an excitation of some joints as one of the whole robot, the others held."""
    if not held:
        return excitation
    return whole_motion(excitation, robot, held)


def _with_sources(excitation: Excitation, args: argparse.Namespace) -> Excitation:
    """Return the excitation with the files in it that it was designed from."""
    given = {"model": args.model, "prior": args.prior, "from": args.run_before}
    return replace(
        excitation, reproduce={**excitation.reproduce, **{key: value for key, value in given.items() if value}}
    )


def process_start() -> float:
    """Return when this process started, on the clock of time.monotonic(): --time-limit counts from there."""
    try:
        with open("/proc/self/stat", encoding="ascii") as stat, open("/proc/uptime", encoding="ascii") as uptime:
            import os

            ticks = float(stat.read().rsplit(")", 1)[1].split()[19]) / os.sysconf("SC_CLK_TCK")
            return time.monotonic() - max(0.0, float(uptime.read().split()[0]) - ticks)
    except (OSError, ValueError, IndexError):  # no /proc: macOS, Windows
        return time.monotonic()

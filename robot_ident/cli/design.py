"""`robot_ident design`."""

from __future__ import annotations

import argparse
import time
from typing import TYPE_CHECKING, Any

from robot_ident.cli.output import Progress, add_json, add_output, add_robot, print_json, say, table, tell, within

if TYPE_CHECKING:
    from robot_ident.excitation.limits import Margins


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's options."""
    add_robot(parser)
    parser.add_argument(
        "--criterion", default="d-optimal", help="d-optimal (c2) or condition (c1); default %(default)s"
    )
    parser.add_argument(
        "--harmonics", type=within(1, 60, int), default=5, help="terms of the Fourier series (default %(default)s)"
    )
    parser.add_argument(
        "--base-frequency", type=within(1e-4, 100.0), default=0.1, metavar="F", help="Hz (default %(default)s)"
    )
    parser.add_argument(
        "--sample-rate", type=within(1.0, 1e5), default=150.0, metavar="HZ", help="Hz (default %(default)s)"
    )
    parser.add_argument(
        "--effect", action="append", default=[], metavar="NAME@JOINT", help="further effects to identify"
    )
    parser.add_argument("--starts", type=within(1, 100_000, int), metavar="N", help="cold starts (default 12)")
    parser.add_argument(
        "--time-limit", type=float, metavar="S", help="wall time; the best so far is kept, as with Ctrl-C"
    )
    parser.add_argument("--seed", type=within(0, 2**31, int), default=0, help="of the starts (default %(default)s)")
    add_output(parser, "EXCITATION", "excitation.yaml to write")
    add_json(parser)


def run(args: argparse.Namespace) -> int:
    """Design an excitation."""
    from robot_ident.errors import InputError
    from robot_ident.excitation.design import Progress as State
    from robot_ident.excitation.design import design
    from robot_ident.files import refuse_existing
    from robot_ident.robot import load_robot

    if args.output:
        refuse_existing(args.output, force=args.force)
    if args.time_limit is not None and not args.time_limit > 0:
        raise InputError(f"--time-limit {args.time_limit}: must be above 0")
    if args.seed < 0:
        raise InputError(f"--seed {args.seed}: must not be negative")
    robot = load_robot(args.robot)
    deadline = None if args.time_limit is None else process_start() + args.time_limit
    with Progress("design", 1.0) as bar:

        def show(state: State) -> None:
            done = state.done / state.planned if state.planned else 0.0
            if args.time_limit is not None:
                done = state.seconds / args.time_limit
            note = f"{state.phase}: det 10^{state.log10_det_covariance:.2f}, condition {state.condition_number:.2f}"
            bar.reach(min(1.0, done), note)

        found = design(
            robot,
            criterion=args.criterion,
            harmonics=args.harmonics,
            base_frequency=args.base_frequency,
            sample_rate=args.sample_rate,
            effects=args.effect,
            starts=args.starts,
            deadline=deadline,
            seed=args.seed,
            progress=show,
        )
    if args.output:
        found.excitation.write(args.output, force=args.force)
    if args.json:
        data: dict[str, Any] = {
            "schema": "robot_ident/design/1",
            "files": [str(args.output)] if args.output else [],
            "log10_det_covariance": found.log10_det_covariance,
            "condition_number": found.condition_number,
            "seconds": found.seconds,
            "margins": found.margins.to_json(),
            "sigma": dict(zip(found.parameters, found.sigma.tolist(), strict=True)),
            "notes": list(found.notes),
        }
        print_json(data)
        return 0
    for note in found.notes:
        tell(note)
    if args.time_limit is not None and found.excitation.reproduce.get("searches", 0) < 3:
        tell("hardly a search ended within the time limit: more time would give a far better motion")
    if found.interrupted:
        tell("stopped early; this is the best so far")
    say(
        f"log10 det of the covariance {found.log10_det_covariance:.2f}, condition number {found.condition_number:.2f}"
        f" ({found.seconds:.0f} s)"
    )
    say(margin_table(found.margins))
    if args.output:
        say(f"written: {args.output}")
    return 0


def process_start() -> float:
    """Return when this process started, on the clock of time.monotonic(): --time-limit counts from there."""
    try:
        with open("/proc/self/stat", encoding="ascii") as stat, open("/proc/uptime", encoding="ascii") as uptime:
            import os

            ticks = float(stat.read().rsplit(")", 1)[1].split()[19]) / os.sysconf("SC_CLK_TCK")
            return time.monotonic() - max(0.0, float(uptime.read().split()[0]) - ticks)
    except (OSError, ValueError, IndexError):  # no /proc: macOS, Windows
        return time.monotonic()


def margin_table(margins: Margins) -> str:
    """Return the tightest point of every limit."""
    rows = [
        (
            m.quantity,
            m.where,
            f"{m.value:.5g}",
            f"{m.limit:.5g}",
            f"{m.margin:.2e}",
            m.unit,
            f"{m.time:.3f}",
            _proof(m.proven),
        )
        for m in margins.items
    ]
    return table(("limit", "joint or rule", "reached", "allowed", "margin", "unit", "at t [s]", "by"), rows)


def _proof(proven: bool) -> str:
    return "proof" if proven else "samples"

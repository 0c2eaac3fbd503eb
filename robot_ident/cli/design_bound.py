"""`robot_ident design --bound --page`: how good the best is, and the design as a page."""

from __future__ import annotations

import argparse
import time
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from robot_ident.cli.options import Options, flag, option
from robot_ident.cli.output import Progress
from robot_ident.errors import InputError

if TYPE_CHECKING:
    from robot_ident.design.bound import Bound
    from robot_ident.design.design import DesignResult
    from robot_ident.design.target import Target
    from robot_ident.signals.motion import Array

_SHARE = 0.4  # of a time limit that is left for the bound


def add_bound_arguments(parser: Options) -> None:
    """Add `--bound` and `--page`."""
    flag(parser, "--bound", "also bound the best criterion within the limits (up to 60 s) and print the D-efficiency")
    option(parser, "--page", "PAGE", "page.html to write: the motion, its limits, its information")


def check_bound_arguments(args: argparse.Namespace) -> None:
    """Raise InputError where the options don't go together, or the page can't be written."""
    from robot_ident.files import refuse_existing

    for name, given in (("--bound", args.bound), ("--page", args.page)):
        if given and args.tell:
            raise InputError(f"{name} goes with a criterion, not with --tell")
    if args.page:
        refuse_existing(args.page, force=args.force)


def until_bound(args: argparse.Namespace, deadline: float | None) -> float | None:
    """Return when the search has to end so that the bound fits into the time limit."""
    from robot_ident.design.bound import TIME_LIMIT

    if deadline is None or not args.bound:
        return deadline
    return deadline - min(TIME_LIMIT, _SHARE * max(0.0, deadline - time.monotonic()))


def bounded(
    args: argparse.Namespace, found: DesignResult, target: Target, prior: Array | None, deadline: float | None
) -> tuple[DesignResult, Bound | None]:
    """Return the design with the bound in what its files say was achieved."""
    if not args.bound:
        return found, None
    from robot_ident.design.bound import TIME_LIMIT, Proof, determinant_bound
    from robot_ident.design.family import family_of

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
    from robot_ident.report.design_sections import design_sections
    from robot_ident.report.page import write_page

    units = tuple(parameter.unit for parameter in target.structure.parameters)
    first = found.excitation
    series = f"{first.harmonics} harmonics of {first.base_frequency:g} Hz, sampled at {first.sample_rate:g} Hz"
    subtitle = f"{first.criterion}, {series}"
    sections = design_sections(found, target.robot, units, bound)
    write_page(args.page, f"Excitation of {first.robot}", sections, subtitle=subtitle, force=args.force)


def bound_json(bound: Bound | None, found: DesignResult) -> dict[str, Any] | None:
    """Return the bound as plain values."""
    return None if bound is None else bound.to_json(found.log10_det_covariance)

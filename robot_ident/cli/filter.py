"""`robot_ident filter`: the anti-alias filter of the torque channel, from its frequency response."""

from __future__ import annotations

import argparse
from dataclasses import replace

from robot_ident.bags import read_for
from robot_ident.cli.identify import to_the_digit
from robot_ident.cli.output import print_json, say, table
from robot_ident.errors import InputError
from robot_ident.recording.process import process
from robot_ident.recording.torque_channel import FrequencyResponse, between, identify_filter
from robot_ident.robot import load_robot


def run(args: argparse.Namespace) -> None:
    """Identify the filter and print the section for the robot YAML."""
    if (args.response is None) == (args.behind is None and args.without is None) or (
        (args.behind is None) != (args.without is None)
    ):
        raise InputError("either RESPONSE.csv, or --with BAG and --without BAG, were expected")
    measured = FrequencyResponse.read(args.response) if args.response else _between(args)
    found = identify_filter(measured, args.order)
    if args.json:
        print_json({"schema": "robot_ident/filter/1", "points": len(measured.frequency), **found.to_dict()})
        return
    kind = found.filter
    say(
        f"{len(measured.frequency)} points, {measured.frequency[0]:.4g} to {measured.frequency[-1]:.4g} Hz:"
        f" order {kind.order}, -3 dB at {kind.cutoff:.4g} Hz, delay of slow signals {1e3 * kind.delay:.3g} ms,"
        f" undone up to {kind.passes(0.5):.4g} Hz"
    )
    rows: list[tuple[str, ...]] = []
    for section, spread in zip(kind.sections, found.deviations, strict=True):
        pairs = zip(section, spread, strict=True)
        rows.append(
            tuple(word for value, std in pairs for word in to_the_digit(value, std)) + ("", "") * (2 - len(section))
        )
    say(table(("frequency [Hz]", "sigma", "quality", "sigma"), rows))
    test = ""
    if found.chi_square is not None:
        ratio = found.chi_square / found.dof
        said = "as the deviations say" if ratio < 1.5 else "more than the deviations say: not this kind of filter alone"
        test = f"; chi-square / dof = {ratio:.2f}, {said}"
    say(f"residual {100 * found.misfit:.2g} % of the response{test}")
    say(f"gain at rest {found.gain:.4f} +- {found.gain_deviation:.4f}: part of torque_constant, not undone here")
    say(f"robot YAML: {found.yaml}")


def _between(args: argparse.Namespace) -> FrequencyResponse:
    """Return the response between the two recordings, of one joint or all."""
    whole = load_robot(args.robot)
    robot = replace(whole, anti_alias=())
    behind, without = (process(read_for(bag, robot), robot) for bag in (args.behind, args.without))
    joint = None if args.joint is None else robot.joint_index(args.joint)
    return between(behind, without, joint)

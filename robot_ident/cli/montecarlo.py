"""`robot_ident montecarlo`."""

from __future__ import annotations

import argparse

from robot_ident.cli.identify import to_the_digit
from robot_ident.cli.output import print_json, say, table
from robot_ident.model.structure import Structure
from robot_ident.robot import load_robot
from robot_ident.testbed.monte_carlo import montecarlo
from robot_ident.trajectories.excitation import Excitation


def run(args: argparse.Namespace) -> None:
    """Repeat the identification and print Table II of the paper."""
    robot = load_robot(args.robot)
    excitation = Excitation.read(args.excitation)
    excitation.check_robot(robot)
    structure = Structure.build(robot, args.effect)
    variance = robot.noise.torque_variance / args.periods
    result = montecarlo(excitation.samples(), structure, variance, runs=args.runs, seed=args.seed)
    if args.json:
        print_json(result.to_dict())
        return
    rows = [
        (n, *(to_the_digit(value, s)[0] for value in (t, m, s, o)), f"{o / s:.3f}", u)
        for n, u, t, m, s, o in zip(
            result.names, result.units, result.true, result.mean, result.sigma, result.sample_sigma, strict=True
        )
    ]
    say(table(("parameter", "true", "mean", "sigma", "observed", "ratio", "unit"), rows))
    p = len(result.names)
    low, high = result.ratio_interval
    say(f"\nmeans within sigma / sqrt({args.runs}): {result.inside_mean} of {p} (the paper: 16 of 21)")
    say(f"sigma ratios within {low:.3f} to {high:.3f}: {result.inside_ratio} of {p} (the paper: 19 of 21)")
    least, most = result.bias_interval
    say(f"bias, {args.runs} D' C^-1 D = {result.bias_statistic:.1f}, expected {least:.1f} to {most:.1f}")
    say(
        f"spread, mean of e' C^-1 e / {p} = {result.error_statistic:.3f},"
        f" expected {result.error_interval[0]:.3f} to {result.error_interval[1]:.3f}"
    )
    say("unbiased and efficient" if result.holds else "NOT as theory says")

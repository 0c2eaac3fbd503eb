"""`robot_ident check`."""

from __future__ import annotations

import argparse

from robot_ident.cli.output import add_json, add_robot, print_json, say, within
from robot_ident.errors import CheckFailed


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's options."""
    parser.add_argument("excitation", metavar="excitation.yaml", help="an excitation or a validation motion")
    add_robot(parser)
    parser.add_argument(
        "--periods", type=within(1, 100_000, int), default=1, help="periods that are played (default %(default)s)"
    )
    add_json(parser)


def run(args: argparse.Namespace) -> int:
    """Certify the periodic motion and its way in and out; exit with 3 when a limit is not kept."""
    from robot_ident.cli.design import margin_table
    from robot_ident.errors import InputError
    from robot_ident.excitation.excitation import Excitation
    from robot_ident.excitation.limits import certify
    from robot_ident.excitation.playback import Playback
    from robot_ident.excitation.point_to_point import load_motion
    from robot_ident.robot import load_robot

    if args.periods < 1:
        raise InputError(f"--periods {args.periods}: at least 1")
    robot = load_robot(args.robot)
    motion = load_motion(args.excitation)
    motion.check_robot(robot)
    margins = certify(motion, robot)
    played = None
    if isinstance(motion, Excitation) and margins.kept:
        played = certify(Playback(motion, robot, args.periods), robot)
    violations = [*margins.violations, *(played.violations if played else ())]
    if args.json:
        data = {"schema": "robot_ident/check/1", "kept": not violations, "margins": margins.to_json()}
        print_json({**data, "played": played.to_json() if played else None})
    else:
        say(margin_table(margins))
        if played:
            say("\nwith the way in and out")
            say(margin_table(played))
    if violations:
        raise CheckFailed(f"{args.excitation}: {violations[0]}")
    if not args.json:
        say("\nevery limit is kept")
    return 0

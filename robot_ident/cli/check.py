"""`robot_ident check`."""

from __future__ import annotations

import argparse
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from robot_ident.cli.output import margin_table, print_json, refuse_unchecked, say, say_unchecked
from robot_ident.cli.values import numbers_of
from robot_ident.errors import CheckFailed, InputError
from robot_ident.limits.certifier import Certifier, Margins, worst_of
from robot_ident.model.model_file import read_model
from robot_ident.planning.approach import approach
from robot_ident.planning.blends import Playback
from robot_ident.robot import Robot, load_robot
from robot_ident.signals.motion import Array
from robot_ident.trajectories.excitation import Excitation
from robot_ident.trajectories.point_to_point import PointToPoint, load_motion

if TYPE_CHECKING:
    from robot_ident.cli.precision import Precision


def run(args: argparse.Namespace) -> None:
    """Certify a motion and its way in and out; exit with 3 when a limit is not kept or not known."""
    robot = load_robot(args.robot)
    start = None
    if args.start is not None:
        expected = f"--from {args.start}: {robot.n} numbers were expected, for {', '.join(robot.joints)}"
        start = np.array(numbers_of(args.start, expected, (robot.n,)))
    motion = load_motion(args.excitation)
    motion.check_robot(robot)
    margins, parts, played = _certified(motion, robot, args.periods, start)
    needed = _precision(args, motion, robot)
    found = [margins, *parts.values()]
    violations = [violation for part in found for violation in part.violations]
    if args.json:
        data = {"schema": "robot_ident/check/1", "kept": not violations, "margins": margins.to_json()}
        names = ("blend_in", "blend_out", "approach")
        data |= {"not_checked": list(margins.unknown), "played": played and played.to_json()}
        data |= {"precision": needed and needed.to_dict()}
        print_json(data | {name: parts[name].to_json() if name in parts else None for name in names})
    else:
        say_unchecked(margins)
        say(margin_table(margins))
        for name, part in parts.items():
            say(f"\n{name.replace('_', '-')}\n{margin_table(replace(part, notes=()))}")
        if needed:
            say(*needed.lines())
    if violations:
        raise CheckFailed(f"{args.excitation}: {violations[0]}")
    if not args.json:
        say("\nevery limit that was checked is kept" if margins.unknown else "\nevery limit is kept")
    refuse_unchecked(args, margins)


def _precision(args: argparse.Namespace, motion: Excitation | PointToPoint, robot: Robot) -> Precision | None:
    """Return how many periods of an excitation --precision takes, None where it isn't asked for."""
    if args.precision is None and not args.parameter:
        return None
    if not isinstance(motion, Excitation):
        raise InputError(f"{args.excitation}: --precision counts the periods of an excitation; this motion has none")
    from robot_ident.cli.precision import precision
    from robot_ident.design.target import Target

    target = Target.of_model(read_model(args.model)) if args.model else Target.of_robot(robot)
    return precision(args, target, [motion])


def _certified(
    motion: Excitation | PointToPoint, robot: Robot, periods: int, start: Array | None
) -> tuple[Margins, dict[str, Margins], Margins | None]:
    """Return the margins of a motion, of its parts (blends and approach, where it keeps the limits itself), and of all
    that is played.
    """
    certifier = Certifier(robot)
    margins = certifier.margins(motion)
    if not margins.kept:
        return margins, {}, None
    parts: dict[str, Margins] = {}
    played: Margins | None = None
    reference = Playback(motion, robot, periods) if isinstance(motion, Excitation) else motion
    if isinstance(reference, Playback):
        parts = certifier.parts(reference)
        played = worst_of(parts.values())
        del parts["periodic"]
    if start is not None:
        parts["approach"] = certifier.margins(approach(start, reference.start_pose, robot))
    return margins, parts, played

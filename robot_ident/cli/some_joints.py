"""`--joints A,B --hold C=ANGLE`: some joints only, the others held."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import TYPE_CHECKING

from robot_ident.cli.output import Options
from robot_ident.errors import InputError

if TYPE_CHECKING:
    from robot_ident.recording.recording import Recording
    from robot_ident.robot import Robot


def add_joints(parser: Options, does: str, *, angle: str) -> None:
    """Add the options.

    does: what the command does with the joints. angle: where a held joint stands that --hold doesn't name.
    """
    parser.add_argument("--joints", metavar="A,B", help=f"{does} these joints only; the others stand still")
    parser.add_argument(
        "--hold",
        action="append",
        default=[],
        metavar="JOINT=ANGLE",
        help=f"with --joints: position of a joint that stands still, rad or m (default: {angle})",
    )


def given_angles(args: argparse.Namespace, robot: Robot) -> dict[str, float]:
    """Return the angles of --hold by joint; InputError names what can't be read, or a joint that is to move."""
    from robot_ident.robot.locked_joints import moving_joints

    out: dict[str, float] = {}
    for word in args.hold:
        name, _, value = word.partition("=")
        try:
            out[name.strip()] = float(value)
        except ValueError:
            raise InputError(f"--hold {word!r}: JOINT=ANGLE was expected, like {robot.joints[-1]}=0.5") from None
        robot.joint_index(name.strip())
    if out and args.joints is None:
        raise InputError("--hold goes with --joints, which names the joints that move")
    both = [name for name in out if name in moving_joints(robot, args.joints)]
    if both:
        raise InputError(f"--hold {both[0]}: --joints moves it")
    return out


def held_for_design(args: argparse.Namespace, robot: Robot) -> tuple[Robot, dict[str, float]]:
    """Return the robot of --joints and the angles of the others: as --hold says, else 0, or the middle of their range
    where 0 lies outside.
    """
    given = given_angles(args, robot)
    if args.joints is None:
        return robot, {}
    from robot_ident.planning.validation_motion import check_angles
    from robot_ident.robot.locked_joints import hold, moving_joints

    moving = moving_joints(robot, args.joints)
    angles = {}
    for joint, name in enumerate(robot.joints):
        if name not in moving:
            lower, upper = float(robot.limits.lower[joint]), float(robot.limits.upper[joint])
            angles[name] = given.get(name, 0.0 if lower < 0.0 < upper else 0.5 * (lower + upper))
    check_angles(robot, angles)
    return hold(robot, moving, angles), angles


def held_in_recordings(
    args: argparse.Namespace, robot: Robot, recordings: Sequence[Recording]
) -> tuple[Robot, list[Recording], dict[str, float]]:
    """Return the robot of --joints, the parts of the recordings in which the others stand still, and where they stand.

    Raises InputError where they stand elsewhere from one recording to the next: the base parameters depend on it.
    """
    given = given_angles(args, robot)
    if args.joints is None:
        return robot, list(recordings), {}
    from robot_ident.recording.checks import STILL, held_angles, still_part
    from robot_ident.robot.locked_joints import hold, moving_joints

    moving = moving_joints(robot, args.joints)
    held = [name for name in robot.joints if name not in moving]
    found = [held_angles(recording, held, given) for recording in recordings]
    for recording, other in zip(recordings[1:], found[1:], strict=True):
        for name in held:
            if abs(other[name] - found[0][name]) > 2.0 * STILL:
                raise InputError(
                    f"{recording.source}: {name} stands at {other[name]:.4g}, in {recordings[0].source} at"
                    f" {found[0][name]:.4g}; the parameters depend on the pose: identify them apart"
                )
    angles = {name: sum(one[name] for one in found) / len(found) for name in held}
    return hold(robot, moving, angles), [still_part(recording, angles) for recording in recordings], angles


def held_note(robot: Robot, angles: dict[str, float]) -> list[str]:
    """Return a line that says which joints are held, and where."""
    if not angles:
        return []
    words = ", ".join(f"{name} at {angle:.4g} {_unit(robot, name)}" for name, angle in angles.items())
    return [f"held: {words}; parameters hold for this pose, links are numbered along the joints that move"]


def _unit(robot: Robot, name: str) -> str:
    return "m" if robot.prismatic[robot.joint_index(name)] else "rad"

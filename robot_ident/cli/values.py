"""What the words of options mean: numbers, angles, effects of a file, how recordings are read and processed."""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Sequence
from pathlib import Path

from robot_ident.cli.options import DEFAULT_ROBOT
from robot_ident.effects import load_effects, register
from robot_ident.errors import InputError
from robot_ident.parallel import prepare
from robot_ident.recording.measurement import Processing
from robot_ident.recording.recording import Recording
from robot_ident.robot.locked_joints import moving_joints
from robot_ident.robot.robot import Robot
from robot_ident.workflow.fitting import excitations_of


def register_effects(files: Sequence[str]) -> None:
    """Add the effects of files to the catalogue of this process and of its workers; call it before one is made."""
    for file in files:
        register(load_effects(file))
        path = Path(file).resolve()
        prepare(_register_source, str(path), path.read_bytes())


def _register_source(path: str, source: bytes) -> None:
    """Add the effects of a file's contents to the catalogue of a worker, which needn't have the file."""
    register(load_effects(path, source))


def numbers_of(text: str, expected: str, lengths: Sequence[int]) -> list[float]:
    """Return the numbers of `X,Y,...`; InputError, with what was expected, unless they are finite and so many."""
    try:
        values = [float(word) for word in text.split(",")]
    except ValueError:
        values = []
    if len(values) not in lengths or any(value - value != 0.0 for value in values):
        raise InputError(expected)
    return values


def angles_of(words: Iterable[str]) -> dict[str, float]:
    """Return the angles of `--hold JOINT=ANGLE` by joint; InputError where a word is none of these."""
    out = {}
    for word in words:
        name, _, angle = word.partition("=")
        try:
            out[name.strip()] = float(angle)
        except ValueError:
            raise InputError(f"--hold {word!r}: JOINT=ANGLE was expected, like joint_3=0.5") from None
    return out


def given_angles(args: argparse.Namespace, robot: Robot) -> dict[str, float]:
    """Return the angles of --hold by joint; InputError names what can't be read, or a joint that is to move."""
    out = angles_of(args.hold)
    for name in out:
        robot.joint_index(name)
    if out and args.joints is None:
        raise InputError("--hold goes with --joints, which names the joints that move")
    both = [name for name in out if name in moving_joints(robot, args.joints)]
    if both:
        raise InputError(f"--hold {both[0]}: --joints moves it")
    return out


def refuse_default_robot(name: str, joints: Sequence[str], recordings: Iterable[Recording]) -> None:
    """Raise InputError where the default robot would be taken for recordings with other joints than its own."""
    for recording in recordings:
        others = [joint for joint in recording.names if joint not in joints]
        if name == DEFAULT_ROBOT and others and {*joints} <= {*recording.names}:
            raise InputError(
                f"{recording.source} holds {', '.join(others)}, which {name}, the default robot, lacks; give --robot"
            )


def bags_of(args: argparse.Namespace) -> list[str]:
    """Return all recordings of a command line; InputError where there is none."""
    bags = [*args.bags, *getattr(args, "after_effects", [])]
    if not bags:
        raise InputError("the following arguments are required: BAG")
    return bags


def processing_of(args: argparse.Namespace, robot: Robot, *, played: Robot) -> Processing:
    """Return the processing that the options ask for; InputError names an option out of its bounds.

    played: the robot that --trajectory is for, `robot` with all its joints.
    """
    frequency = args.base_frequency
    if args.trajectory:
        excitations = excitations_of(args.trajectory, played)
        frequencies = sorted({one.base_frequency for one in excitations})
        if len(frequencies) > 1:
            told = ", ".join(f"{one:g}" for one in frequencies)
            raise InputError(f"--trajectory: base frequencies of {told} Hz; identify recordings of one period together")
        frequency = frequencies[0]
    low_pass, wide = args.low_pass, args.derivative_bandwidth
    if low_pass is not None and wide is not None and wide < low_pass:
        raise InputError(
            f"--derivative-bandwidth {wide:g} contradicts --low-pass {low_pass:g}: acceleration must reach as far as"
            " torque"
        )
    return Processing(
        base_frequency=frequency,
        periodic=False if args.not_periodic else (True if frequency else None),
        low_pass=args.low_pass,
        derivative_bandwidth=args.derivative_bandwidth,
        decimate=args.decimate,
        minimum_speed=_speeds(args.minimum_speed, robot),
        anti_alias=_filter(args.anti_alias),
    )


def _filter(text: str | None) -> tuple[float, float] | None:
    """Return (order, Hz) of `8:40`, (0, 0) for `none`, None where nothing is said."""
    if text is None:
        return None
    if text.strip().lower() == "none":
        return 0.0, 0.0
    order, _, cutoff = text.partition(":")
    try:
        found = float(int(order)), float(cutoff)
    except ValueError as error:
        raise InputError(f"--anti-alias {text!r}: ORDER:HZ was expected, like 8:40, or none") from error
    if not 1 <= found[0] <= 12 or not 0 < found[1] < float("inf"):
        raise InputError(f"--anti-alias {text!r}: the order must be 1 to 12 and the frequency above 0")
    return found


def _speeds(text: str | None, robot: Robot) -> tuple[float, ...] | None:
    if text is None:
        return None
    expected = f"--minimum-speed {text!r}: one value or {robot.n}, separated by commas, were expected, none negative"
    values = numbers_of(text, expected, (1, robot.n))
    if min(values) < 0:
        raise InputError(expected)
    return tuple(values * robot.n if len(values) == 1 else values)

"""How options are declared (a flag, a word, several, a number between bounds), and those that several commands share:
how recordings are read and processed, some joints only, effects by name or from a file.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from robot_ident.errors import InputError

if TYPE_CHECKING:
    from robot_ident.recording.measurement import Processing
    from robot_ident.recording.recording import Recording
    from robot_ident.robot.robot import Robot


def within(lower: float, upper: float, kind: type[float] | type[int] = float) -> Callable[[str], float]:
    """Return a type for an option: a number between bounds, inclusive."""

    def number(text: str) -> float:
        what = "a whole number" if kind is int else "a number"
        try:
            value = kind(text)
        except ValueError:
            raise argparse.ArgumentTypeError(f"{text}: {what} is expected") from None
        if not lower <= value <= upper:
            raise argparse.ArgumentTypeError(f"{text}: {what} from {lower:g} to {upper:g} is expected")
        return value

    return number


Options: TypeAlias = argparse._ActionsContainer
"""What takes options: a parser, or one of its groups, which the help shows under a heading."""


def add_json(parser: Options) -> None:
    """Add `--json`."""
    flag(parser, "--json", "print one JSON object on standard output, nothing else")


def add_cluster(parser: Options) -> None:
    """Add `--cluster`."""
    option(parser, "--cluster", "ADDRESS", "run on a Dask scheduler (tcp://HOST:PORT) instead of local processes")


def flag(parser: Options, name: str, text: str) -> None:
    """Add an option without a value."""
    parser.add_argument(name, action="store_true", help=text)


def option(
    parser: Options, name: str, metavar: str | tuple[str, ...] | None, text: str, default: Any = None, **more: Any
) -> None:
    """Add an option with a value, a word unless `more` says otherwise; its help says its default, if any."""
    says_default = default is None or "%(default)s" in text
    words = text if says_default else f"{text} (default: %(default)s)"
    parser.add_argument(name, metavar=metavar, default=default, help=words, **more)


def several(parser: Options, name: str, metavar: str, text: str, **more: Any) -> None:
    """Add an option with one value or several after it."""
    parser.add_argument(name, metavar=metavar, help=text, **{"nargs": "+", "default": [], **more})


def each(parser: Options, name: str, metavar: str, text: str) -> None:
    """Add an option that is given once for each value."""
    parser.add_argument(name, action="append", default=[], metavar=metavar, help=text)


def number(
    parser: Options, name: str, metavar: str | None, bounds: tuple[float, float], text: str, default: Any = None
) -> None:
    """Add an option with a number between bounds, inclusive."""
    option(parser, name, metavar, text, default, type=within(*bounds))


def count(
    parser: Options, name: str, metavar: str | None, bounds: tuple[int, int], text: str, default: Any = None
) -> None:
    """Add an option with a whole number between bounds, inclusive."""
    option(parser, name, metavar, text, default, type=within(*bounds, int))


DEFAULT_ROBOT = "kuka_ir361"


def refuse_default_robot(name: str, joints: Sequence[str], recordings: Iterable[Recording]) -> None:
    """Raise InputError where the default robot would be taken for recordings with other joints than its own."""
    for recording in recordings:
        others = [joint for joint in recording.names if joint not in joints]
        if name == DEFAULT_ROBOT and others and {*joints} <= {*recording.names}:
            raise InputError(
                f"{recording.source} holds {', '.join(others)}, which {name}, the default robot, lacks; give --robot"
            )


def add_robot(parser: Options, default: str | None = DEFAULT_ROBOT) -> None:
    """Add `--robot`."""
    text = f"kuka_ir361, kuka_ir361_spring, a robot YAML or a URDF (default: {default or 'none'})"
    parser.add_argument("--robot", default=default, metavar="R", help=text)


def add_output(parser: Options, metavar: str, text: str, *, required: bool = False) -> None:
    """Add `-o` and `--force`."""
    parser.add_argument("-o", "--output", metavar=metavar, required=required, help=text)
    flag(parser, "--force", "overwrite existing files")


def add_accept_unchecked(parser: Options) -> None:
    """Add `--accept-unchecked`."""
    text = "exit with 0 although limits or collisions were not checked; the output still lists them"
    flag(parser, "--accept-unchecked", text)


class _Effects(argparse.Action):
    """Takes effects; a recording that follows them is one still."""

    def __call__(
        self,
        parser: argparse.ArgumentParser,
        namespace: argparse.Namespace,
        values: str | Sequence[Any] | None,
        option_string: str | None = None,
    ) -> None:
        words = [values] if isinstance(values, str) else list(values or ())
        bags = [word for word in words[1:] if os.path.exists(word)]
        effects = [*words[:1], *(word for word in words[1:] if word not in bags)]
        setattr(namespace, self.dest, [*getattr(namespace, self.dest), *effects])
        namespace.after_effects = [*namespace.after_effects, *bags]


def add_bags_and_effects(parser: Options, model: Options) -> None:
    """Add the recordings to a parser, and `--effect` to its group of the model."""
    parser.add_argument("bags", nargs="*", metavar="BAG", help="recordings to fit, periodic or not")
    several(model, "--effect", "NAME@JOINT", "additional effects in the model", action=_Effects)
    parser.set_defaults(after_effects=[])


def bags_of(args: argparse.Namespace) -> list[str]:
    """Return all recordings of a command line; InputError where there is none."""
    bags = [*args.bags, *args.after_effects]
    if not bags:
        raise InputError("the following arguments are required: BAG")
    return bags


def add_effects_from(parser: argparse.ArgumentParser) -> None:
    """Add the option."""
    each(parser, "--effects-from", "FILE.py", "Python file with user-defined effects (see examples/my_effects.py)")


def register_effects(files: Sequence[str]) -> None:
    """Add the effects of files to the catalogue of this process and of its workers; call it before one is made."""
    if not files:
        return
    from robot_ident.effects import load_effects, register
    from robot_ident.parallel import prepare

    for file in files:
        register(load_effects(file))
        path = Path(file).resolve()
        prepare(_register_source, str(path), path.read_bytes())


def _register_source(path: str, source: bytes) -> None:
    """Add the effects of a file's contents to the catalogue of a worker, which needn't have the file."""
    from robot_ident.effects import load_effects, register

    register(load_effects(path, source))


AS_DECLARED = ", or continue with --as-declared"


def add_reading(parser: Options) -> None:
    """Add the options of reading."""
    period = parser.add_mutually_exclusive_group()
    text = "excitation.yaml that was played: sets the period; give it once, or once per recording in their order"
    option(period, "--trajectory", "EXCITATION", text, action="append")
    text = "base frequency of the motion, Hz (default: detected from the data)"
    number(period, "--base-frequency", "F", (1e-4, 1e4), text)
    flag(period, "--not-periodic", "treat the recording as non-periodic")
    option(parser, "--topic", "T", "topic of the joint states (default: joint_states in any namespace)")


def add_processing(parser: Options) -> None:
    """Add the options of processing."""
    text = "low-pass filter of effort and regressor (default: none if periodic, else 10 Hz)"
    number(parser, "--low-pass", "HZ", (0.01, 1e5), text)
    text = "low-pass filter of non-periodic positions before differentiation (default: 4 times --low-pass)"
    number(parser, "--derivative-bandwidth", "HZ", (0.01, 1e5), text)
    count(parser, "--decimate", "K", (1, 1000), "keep every K-th row after the low-pass filter", 1)
    text = "exclude rows slower than this, rad/s or m/s: one value, or one per joint (default: the robot's)"
    option(parser, "--minimum-speed", "V[,V...]", text)
    text = "compensate this Butterworth filter of the recorded effort; none: no filter (default: the robot YAML's)"
    option(parser, "--anti-alias", "ORDER:HZ", text)


def processing_of(args: argparse.Namespace, robot: Robot, *, played: Robot) -> Processing:
    """Return the processing that the options ask for; InputError names an option out of its bounds.

    played: the robot that --trajectory is for, `robot` with all its joints.
    """
    from robot_ident.recording.measurement import Processing

    frequency = args.base_frequency
    if args.trajectory:
        from robot_ident.workflow.fitting import excitations_of

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


def numbers_of(text: str, refusal: str) -> list[float]:
    """Return the numbers of `X,Y,...`; InputError(refusal) where one of the words is none."""
    try:
        return [float(word) for word in text.split(",")]
    except ValueError as error:
        raise InputError(refusal) from error


def _speeds(text: str | None, robot: Robot) -> tuple[float, ...] | None:
    if text is None:
        return None
    values = numbers_of(text, f"--minimum-speed {text!r}: numbers separated by commas were expected")
    if len(values) not in (1, robot.n) or any(not value >= 0 for value in values):
        raise InputError(f"--minimum-speed {text!r}: give one value or {robot.n}, none negative")
    return tuple(values * robot.n if len(values) == 1 else values)


def add_recordings(parser: Options) -> None:
    """Add `--validation` and `--topic`."""
    add_validation(parser)
    option(parser, "--topic", "T", "topic of the joint states")


def add_validation(parser: Options) -> None:
    """Add the recordings of the validation: several after one option, or one after each."""
    several(parser, "--validation", "BAG2", "validation recordings, never used in a fit", action="extend")


def add_joints(parser: Options, does: str, *, angle: str) -> None:
    """Add the options.

    does: what the command does with the joints. angle: where a held joint stands that --hold doesn't name.
    """
    option(parser, "--joints", "A,B", f"{does} these joints only; the others stand still")
    text = f"with --joints: position of a joint that stands still, rad or m (default: {angle})"
    each(parser, "--hold", "JOINT=ANGLE", text)


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

"""`robot_ident design`: motions from the robot's limits, or within the envelope of what it has run already (`--from
BAG`), and how many periods a precision takes (`--precision 5% --parameter p3`).
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from robot_ident.cli.design_bound import (
    add_bound_arguments,
    bound_json,
    bound_lines,
    bounded,
    check_bound_arguments,
    until_bound,
    write_design_page,
)
from robot_ident.cli.design_kinds import (
    add_waypoints,
    check_iterate,
    criteria_line,
    design_json,
    finish,
    run_iterate,
    run_tell,
    run_validation,
    run_waypoints,
    share_done,
)
from robot_ident.cli.options import (
    DEFAULT_ROBOT,
    Options,
    add_accept_unchecked,
    add_cluster,
    add_joints,
    add_json,
    add_output,
    count,
    each,
    flag,
    held_for_design,
    held_note,
    number,
    option,
    several,
)
from robot_ident.cli.output import Progress, table
from robot_ident.errors import InputError, did_you_mean

if TYPE_CHECKING:
    from robot_ident.design.design import DesignResult
    from robot_ident.design.target import Needed, Target
    from robot_ident.model.model import Model
    from robot_ident.recording.recording import Recording
    from robot_ident.robot import Robot
    from robot_ident.signals.motion import Array
    from robot_ident.trajectories.excitation import Excitation


_BANDWIDTH = 10.0  # Hz of the derivatives of what does not repeat: beyond, noise would widen the envelope
_POINTS = 4000  # of a recording at which the tool is looked at


def within_runs(args: argparse.Namespace, robot: Robot, whole: Robot) -> Robot:
    """Return the robot with the envelope of the recordings of --from as its limits; itself where there are none.

    whole: the robot with all its joints, of which `robot` may hold some: its tool has been where all of them took it.
    """
    if not args.run_before:
        return robot
    import numpy as np

    from robot_ident.bags import read_for
    from robot_ident.limits.envelope import within_envelope
    from robot_ident.recording.measurement import Processing
    from robot_ident.recording.process import process
    from robot_ident.signals.motion import Motion

    motions, places = [], []
    for bag in args.run_before:
        recording = read_for(bag, robot)
        measured = process(recording, robot, Processing(derivative_bandwidth=_BANDWIDTH), motion_only=True)
        edge = 0 if measured.base_frequency is not None else round(1.0 / (_BANDWIDTH * measured.dt))
        kept = measured.motion[slice(edge, measured.motion.samples - edge)]
        motions.append(Motion(kept.q, kept.dq, kept.ddq))
        places.append(_places(recording, robot, whole))
    return within_envelope(robot, motions, np.concatenate(places))


def _places(recording: Recording, robot: Robot, whole: Robot) -> Array:
    """Return where the tool was [N, 3] m: with all joints as recorded, or those held that the recording lacks."""
    seen = whole if set(whole.joints) <= set(recording.names) else robot
    q = recording.with_joints(seen.joints).q
    return seen.rigid.frame_position(q[:: max(1, len(q) // _POINTS)], robot.end_effector)


@dataclass(frozen=True)
class Precision:
    """The share that was asked for, what each parameter takes, the length [s] of a period (of all motions), and whether
    the values are estimates or what the robot's files say.
    """

    share: float
    needed: tuple[Needed, ...]
    period: float
    estimated: bool

    @property
    def periods(self) -> int | None:
        """Periods that all of them take, None where one can't be said."""
        counts = [one.periods for one in self.needed]
        return max((count for count in counts if count is not None), default=None) if None not in counts else None


def add_precision(parser: Options) -> None:
    """Add the options."""
    option(
        parser, "--precision", "P", "also print how many periods bring sigma down to this ratio of the value, e.g. 5%%"
    )
    each(
        parser,
        "--parameter",
        "NAME",
        "with --precision: only this parameter (default: all); its value comes from --model or the robot's files",
    )


def check_precision(args: argparse.Namespace, target: Target) -> None:
    """Raise InputError where the options can't be used."""
    if args.precision is not None:
        share_of(args.precision)
    elif args.parameter:
        raise InputError("--parameter goes with --precision, like --precision 5%")
    names = target.structure.names
    for name in args.parameter:
        if name not in names:
            raise InputError(f"--parameter {name!r}{did_you_mean(name, names)}")


def precision(
    args: argparse.Namespace, target: Target, excitations: Sequence[Excitation], prior: Array | None = None
) -> Precision | None:
    """Return how many periods the parameters take, None where --precision isn't given."""
    check_precision(args, target)
    if args.precision is None:
        return None
    import numpy as np

    from robot_ident.design.target import periods_needed

    share = share_of(args.precision)
    names = target.structure.names
    rows = [target.rows(one) / np.sqrt(target.periods) for one in excitations]
    information = np.sum([part.T @ part for part in rows], axis=0)
    values = target.values if target.estimated and target.values is not None else target.structure.true_values()
    units = [parameter.unit for parameter in target.structure.parameters]
    needed = periods_needed(information, values, names, units, share, prior)
    asked = tuple(one for one in needed if one.name in (args.parameter or names))
    return Precision(share, asked, sum(one.period for one in excitations), target.estimated)


def share_of(text: str) -> float:
    """Return the share that `5%`, `5 %` or `0.05` means; InputError unless it is between 0 and 1."""
    word = text.strip()
    try:
        share = float(word[:-1]) / 100.0 if word.endswith("%") else float(word)
    except ValueError:
        share = 0.0
    if not 0.0 < share < 1.0:
        raise InputError(f"--precision {text!r}: a ratio of the value was expected, like 5% or 0.05")
    return share


def precision_json(found: Precision | None) -> dict[str, Any] | None:
    """Return plain values."""
    if found is None:
        return None
    return {
        "share": found.share,
        "periods": found.periods,
        "seconds": None if found.periods is None else found.periods * found.period,
        "estimated": found.estimated,
        "parameters": [asdict(one) for one in found.needed],
    }


def precision_lines(found: Precision | None) -> list[str]:
    """Return what each parameter takes, the most demanding first."""
    if found is None:
        return []
    most = float("inf")
    order = sorted(found.needed, key=lambda one: -(most if one.periods is None else one.periods))
    rows = [(one.name, one.value, one.sigma, one.unit, _periods(one)) for one in order]
    whose = "the model's" if found.estimated else "of the robot's files"
    out = [table(("parameter", "value", "sigma of one period", "unit", f"periods for {100 * found.share:g} %"), rows)]
    if found.periods is not None:
        out.append(f"{found.periods} periods ({found.periods * found.period:.4g} s) for all of these")
    return [*out, f"values are {whose}; sigma from noise alone: model errors do not average out"]


def _periods(one: Needed) -> str:
    if one.value == 0.0:
        return "value not known: give --model"
    return "never" if one.periods is None else str(one.periods)


_EXIT = 0.8  # s that writing, and ending the worker processes, take
_WHOLE = 2.0  # s for the certificate of the whole robot where some joints are held


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's options."""
    _add_purpose(parser.add_argument_group("what to optimise"))
    motion = parser.add_argument_group("motion")
    count(motion, "--harmonics", "L", (1, 60), "harmonics of the Fourier series (default: 5)")
    number(motion, "--base-frequency", "F", (1e-4, 100.0), "base frequency of the Fourier series, Hz", 0.1)
    option(motion, "--bandwidth", "LO:HI", "use L harmonics within this band only, Hz")
    number(motion, "--sample-rate", "HZ", (1.0, 1e5), "sample rate of the trajectory, Hz", 150.0)
    flag(motion, "--symmetric", "make q(-t) = q(t), which separates friction from conservative torque errors")
    count(
        motion, "--trajectories", "K", (1, 20), "optimise K trajectories jointly; -o NAME.yaml writes NAME_1.yaml...", 1
    )
    add_waypoints(motion)
    flag(
        motion,
        "--validation-motion",
        "instead of an excitation, draw 20 random points with maximum acceleration and a full stop at each",
    )
    limits = parser.add_argument_group("limits")
    text = "stay inside the envelope of these recordings: positions, speeds, accelerations, tool positions"
    several(limits, "--from", "BAG", text, dest="run_before")
    add_joints(limits, "move", angle="0")
    add_accept_unchecked(limits)
    search = parser.add_argument_group("search")
    count(search, "--starts", "N", (1, 100_000), "random starts of the optimiser (default: 12)")
    text = "stop after S seconds of wall time and keep the best result"
    option(search, "--time-limit", "S", text, type=float)
    count(search, "--seed", None, (0, 2**31), "seed of the random starts", 0)
    add_cluster(search)
    output = parser.add_argument_group("output")
    add_output(output, "EXCITATION", "excitation.yaml to write")
    add_bound_arguments(output)
    add_precision(output)
    add_json(output)


def _add_purpose(group: Options) -> None:
    option(
        group,
        "--robot",
        "R",
        "kuka_ir361, kuka_ir361_spring, a robot YAML, URDF or model.yaml (default: --model's, else kuka_ir361)",
    )
    text = (
        "d-optimal (log det of the covariance), condition (condition number) or crlb (d-optimal with position noise,"
        " needs --model or --iterate); default: %(default)s"
    )
    option(group, "--criterion", None, text, "d-optimal")
    several(group, "--effect", "NAME@JOINT", "additional effects to identify", action="extend")
    flag(
        group,
        "--iterate",
        "with --criterion crlb: measure the simulated robot, estimate, design again until sigma no longer falls;"
        " --starts and --time-limit are those of each design",
    )
    option(group, "--model", "MODEL", "model.yaml whose parameters to optimise for")
    several(group, "--prior", "BAG", "recordings or models whose information is already available")
    text = "optimise for the payload's parameters alone, with friction re-estimated"
    group.add_argument("--only", choices=("payload",), help=text)
    option(group, "--tell", ("A@j", "B@k"), "optimise the motion to discriminate between two effects", nargs=2)


def run(args: argparse.Namespace) -> int:
    """Design excitations."""
    from robot_ident.files import refuse_existing
    from robot_ident.workflow.inputs import prior_information

    files = output_files(args.output, args.trajectories)
    for file in files:
        refuse_existing(file, force=args.force)
    if args.time_limit is not None and not args.time_limit > 0:
        raise InputError(f"--time-limit {args.time_limit}: must be above 0")
    check_bound_arguments(args)
    if args.iterate:
        check_iterate(args)
    band = bandwidth_of(args.bandwidth)
    model, whole = _model_and_robot(args)
    robot, held = held_for_design(args, whole)
    _check_model(args, model, robot)
    robot = within_runs(args, robot, whole)
    if args.validation_motion:
        return run_validation(args, _target(args, model, robot), files)
    if args.waypoints:
        return run_waypoints(args, _target(args, model, robot), files)
    if args.iterate:
        return run_iterate(args, robot, files)
    target = _target(args, model, robot)
    check_precision(args, target)
    prior = prior_information(args.prior, target, model, bound=args.criterion == "crlb")
    if args.only:
        from robot_ident.design.target import all_but_payload

        prior = all_but_payload(target) + (0.0 if prior is None else prior)
    limit = args.time_limit
    deadline = None if limit is None else process_start() + limit - min(_EXIT + _WHOLE * bool(held), 0.1 * limit)
    if args.tell:

        def finished(excitation: Excitation) -> Excitation:
            return _moved_alone(_with_sources(excitation, args), whole, held)

        return run_tell(args, target, prior, deadline, files, finished)
    found = _design(args, robot, target, prior, band, until_bound(args, deadline))
    try:
        found, bound = bounded(args, found, target, prior, deadline)
    except KeyboardInterrupt:  # what was designed is kept, without a bound
        found, bound = replace(found, interrupted=True), None
    found = replace(found, excitations=tuple(_with_sources(one, args) for one in found.excitations))
    needed = precision(args, target, found.excitations, prior)
    if args.page:
        write_design_page(args, found, target, bound)
    more = {"bound": bound_json(bound, found), "page": args.page, "held": held, "precision": precision_json(needed)}
    data = design_json(files, found, found.parameters, found.margins, found.seconds, found.notes, **more)
    together = f" of {len(found.excitations)} motions together" if len(found.excitations) > 1 else ""
    beside = ", the earlier recordings included" if args.prior else ""
    lines = [
        criteria_line(found, found.seconds, together + beside),
        *bound_lines(bound, found),
        *precision_lines(needed),
    ]
    stopped = ("stopped early: this is the best excitation so far",) if found.interrupted else ()
    notes = (*held_note(whole, held), *found.notes, *stopped)
    written = [_moved_alone(one, whole, held) for one in found.excitations]
    return finish(args, files, written, found.margins, data, lines, notes=notes, checked=True)


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
    from robot_ident.model.model_file import is_model, read_model
    from robot_ident.robot import load_robot

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
    from robot_ident.design.target import Target

    return Target.of_robot(robot, args.effect) if model is None else Target.of_model(model, args.effect, robot=robot)


def _design(
    args: argparse.Namespace,
    robot: Robot,
    target: Target,
    prior: Array | None,
    band: tuple[float, float] | None,
    deadline: float | None,
) -> DesignResult:
    from robot_ident.design.design import Progress as State
    from robot_ident.design.design import design

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
    from robot_ident.planning.validation_motion import whole_motion

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

"""`robot_ident demo`: an end-to-end example on a simulated KUKA with hidden effects."""

from __future__ import annotations

import argparse
import importlib.util
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from robot_ident.cli.output import add_json, print_json, say, table, tell, within
from robot_ident.errors import InputError

if TYPE_CHECKING:
    from robot_ident.cli.demo_experiment import Run
    from robot_ident.cli.until_adequate import Additions
    from robot_ident.diagnosis.staircase import Step
    from robot_ident.model.model import Model
    from robot_ident.report.findings import Findings
    from robot_ident.robot import Robot
    from robot_ident.signals.motion import Array

# What the real robot was found to have and the paper's 21 parameters lack: axis 2's gravity spring (slack at its
# shortest), axis 1's current offset (KU Leuven, 2006), friction that rises at low speed. Sizes by which every joint's
# residual begins at two to three times its noise (in the paper's figure 4: 1.5 to 1.9 times).
HIDDEN = (
    "gravity_spring@joint_2:stiffness=16000,free_length=0.388",
    "torque_offset@joint_1:-12.72",
    "stribeck@joint_3:stribeck=40,speed=0.1",
)
_QUIET = 1e-6  # of the noise's variance: as good as none, and the weights keep their ratios


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's options."""
    parser.add_argument(
        "--periods",
        type=within(2, 1000, int),
        default=10,
        help="steady periods of each trajectory (default %(default)s)",
    )
    parser.add_argument(
        "--design-time", type=within(1.0, 3600.0), default=16.0, metavar="S", help="to optimise the excitations"
    )
    parser.add_argument(
        "--hidden",
        nargs="*",
        default=HIDDEN,
        metavar="NAME@JOINT:VALUE",
        help="what the robot has and the paper's model lacks",
    )
    parser.add_argument(
        "--seed", type=within(0, 2**31, int), default=0, help="of design and noise (default %(default)s)"
    )
    parser.add_argument("--folder", default="robot_ident_demo", help="where everything is kept (default ./%(default)s)")
    parser.add_argument("--force", action="store_true", help="replace the folder of an earlier demo")
    add_json(parser)


def run(args: argparse.Namespace) -> int:
    """Design, excite, record, identify, diagnose, add, validate."""
    from robot_ident.cli.demo_experiment import design_motions, record
    from robot_ident.robot import load_robot

    started = time.monotonic()
    if args.periods < 2:
        raise InputError(f"--periods {args.periods}: at least 2 are needed to measure the noise")
    if importlib.util.find_spec("rclpy") is None:
        raise InputError("the demo needs ROS 2; install it with pip install '.[ros]' in the checkout")
    folder = _folder(Path(args.folder), args.force)
    robot = load_robot()
    tell(f"Simulated {robot.name}: designed, recorded, identified and diagnosed; all files are in {folder}/")
    runs = design_motions(robot, folder, periods=args.periods, seconds=args.design_time, seed=args.seed)
    record(runs, folder, seed=args.seed, hidden=args.hidden)
    added = _identify(robot, runs, folder)
    page = folder / "report.html"
    found = _report(runs, len(added.steps), folder, page)
    truth = _without_noise(found.last.model, runs, args.hidden)
    seconds = time.monotonic() - started
    if args.json:
        print_json({**_to_dict(found, added, truth, runs, seconds), "report": str(page)})
        return 0
    say(_summary(found, added, truth))
    say(f"\nOpen {page} in a browser. Excitations, recordings (rosbag2 MCAP), models and logs are beside it.")
    say(f"{seconds:.0f} s in all.")
    return 0


def _folder(folder: Path, force: bool) -> Path:
    """Make the folder; that of an earlier demo is kept beside the new one, or replaced on request."""
    import shutil

    mark = ".robot_ident_demo"
    if (folder / mark).exists():
        if force:
            shutil.rmtree(folder)
        else:
            folder = next(p for k in range(2, 10_000) if not (p := Path(f"{folder}_{k}")).exists())
    try:
        folder.mkdir(parents=True)
    except OSError as error:
        raise InputError(f"--folder {folder}: can't be made ({error.strerror})") from error
    (folder / mark).write_text("made by robot_ident demo\n")
    return folder


def _identify(robot: Robot, runs: list[Run], folder: Path) -> Additions:
    """Identify the paper's model and add what `diagnose --add-until-adequate` names; write every model of the way."""
    from robot_ident.bags import read_recording
    from robot_ident.cli.loop import read_inputs
    from robot_ident.cli.until_adequate import add_until_adequate
    from robot_ident.diagnosis.diagnose import diagnose
    from robot_ident.estimation.identify import estimate
    from robot_ident.model.model_file import write_model
    from robot_ident.model.structure import Structure
    from robot_ident.provenance import provenance
    from robot_ident.recording.process import process

    tell("[3/5] Identifying the paper's 21 parameters (weighted least squares)")
    *fitted, validation = [str(motion.bag) for motion in runs]
    model = estimate([process(read_recording(bag), robot) for bag in fitted], Structure.build(robot))
    origin = provenance(fitted, {"demo": True})
    write_model(replace(model, provenance=origin), folder / "model_1.yaml")
    tell(
        "[4/5] Diagnosing: is the residual noise? If not, selecting the missing effects and adding one after the other"
    )
    inputs = read_inputs([str(folder / "model_1.yaml"), *fitted], [validation], None)
    first = diagnose(inputs.measurements, inputs.models[0].structure, inputs.validation)
    added = add_until_adequate(first, inputs, argparse.Namespace(validation=[validation], topic=None))
    for number, step in enumerate(added.steps[1:], 2):
        write_model(replace(step.model, provenance=origin), folder / f"model_{number}.yaml")
    return added


def _report(runs: list[Run], count: int, folder: Path, page: Path) -> Findings:
    """Compare the models with the recordings, from what is on disk, and write the report."""
    import shlex

    from robot_ident.model.model_file import read_model
    from robot_ident.report.findings import gather, read_excitations, read_sources
    from robot_ident.report.sections import write_report

    tell("[5/5] Validating on 20 points with full stops, a motion that enters no fit; writing the report")
    paths = [str(folder / f"model_{number}.yaml") for number in range(1, count + 1)]
    models = [(path, read_model(path)) for path in paths]
    *fitted, validation = [str(motion.bag) for motion in runs]
    played = [str(motion.file) for motion in runs[:-1]]
    words = ["robot_ident", "report", *paths, "--bag", *fitted, "--validation", validation]
    words += [word for file in played for word in ("--trajectory", file)]
    found = gather(
        models,
        read_sources(fitted, models[0][1]),
        read_sources([validation], models[0][1]),
        read_excitations(played, []),
        command=shlex.join([*words, "-o", str(page)]),
    )
    write_report(page, found)
    return found


def _without_noise(model: Model, runs: list[Run], hidden: Sequence[str]) -> Array:
    """Return the parameters [p] that the same robot gives without noise: the truth in the model's own form.

    The true values themselves, but where the model's formula is not the simulated one (Stribeck friction) and where an
    effect merges with another parameter (the spring's sine with gravity).
    """
    from robot_ident.estimation.identify import estimate
    from robot_ident.excitation.excitation import Excitation
    from robot_ident.recording.process import process
    from robot_ident.simulation.periodic import Play
    from robot_ident.simulation.physics import plant_physics

    physics = plant_physics(model.robot, list(hidden))
    plays = [Play.of(model.robot, physics, Excitation.read(motion.file).series) for motion in runs[:-1]]
    quiet = [process(play.record(2, noise=_QUIET), model.robot) for play in plays]
    return estimate(quiet, model.structure).linear


def _summary(found: Findings, added: Additions, truth: Array) -> str:
    """Return the excess over noise from step to step, and what it comes to in words."""
    joints, steps = found.robot.joints, found.steps
    explained = {suspect.label: suspect.explained for said in added.said for suspect in said.missing}
    rows: list[tuple[object, ...]] = []
    for step in steps:
        name = " ".join(f"+ {label}" for label in step.added) or "paper's model"
        share = " ".join(f"{100 * explained[label]:.0f} %" for label in step.added if label in explained)
        rows.append((name, share, *(_pair(step, joint, "excess") for joint in joints)))
    rows.append(("noise", "", *(_pair(steps[0], joint, "noise") for joint in joints)))
    title = "Excess over noise [Nm rms], fitted recordings / validation motion:"
    ratios = ", ".join(f"{_ratio(steps[0], joint):.1f}" for joint in joints)
    lines = ["", title, table(("model", "explains", *joints), rows), ""]
    lines.append(f"Paper's model: residual / noise = {ratios}. {_ending(found, added)}")
    z = abs(found.last.model.linear - truth) / found.last.model.std[: len(truth)]
    lines.append(
        f"{int((z < 2).sum())} of {len(z)} parameters are within 2 sigma of their values without noise;"
        f" the farthest is off by {z.max():.1f} sigma."
    )
    return "\n".join(lines)


def _ending(found: Findings, added: Additions) -> str:
    """Return the last verdict in a sentence: with the effects selected where there are any."""
    names = [label for step in found.steps for label in step.added]
    last = f"{added.last.in_words}{'; ' + added.stopped if added.stopped else ''}."
    if not names:
        return f"diagnose: {last}"
    return f"With the {len(names)} effects that diagnose selected, the model is {last}"


def _pair(step: Step, joint: str, figure: str) -> str:
    """Return a level's `excess` or `noise` at a joint, on fitted recordings and on the validation."""
    values = [getattr(levels[joint], figure) for levels in (step.training, step.validation)]
    return " / ".join("-" if value is None else f"{value:.1f}" for value in values)


def _ratio(step: Step, joint: str) -> float:
    level = step.training[joint]
    return level.rms / (level.noise or level.rms)


def _to_dict(found: Findings, added: Additions, truth: Array, runs: list[Run], seconds: float) -> dict[str, Any]:
    from robot_ident.estimation.validate import validate

    models = [step.model for step in found.steps]
    return {
        "schema": "robot_ident/demo/1",
        "seconds": seconds,
        "folder": str(runs[0].file.parent),
        "bags": [str(motion.bag) for motion in runs],
        "true_values": dict(zip(models[-1].structure.names, truth.tolist(), strict=True)),
        "model": models[-1].to_dict(),
        "models": [model.to_dict() for model in models],
        "diagnosis": added.said[0].to_dict(),
        "validation": validate(models[-1], found.validation[0].recording).to_dict(),
    }

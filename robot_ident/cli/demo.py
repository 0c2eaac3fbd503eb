"""`robot_ident demo`: the whole story on a simulated KUKA with a hidden effect."""

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
    from robot_ident.diagnosis.diagnosis import Diagnosis
    from robot_ident.estimation.validate import Validation
    from robot_ident.model.model import Model
    from robot_ident.motion import Array
    from robot_ident.robot import Robot

# A biased current sensor, and KU Leuven's rotor of axis 3 (0.9935e-3 kg m^2 through a gear of 51.44): the paper's 21
# parameters have a column for neither.
HIDDEN = ("torque_offset@joint_2:6", "rotor_inertia@joint_3:2.63")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's options."""
    parser.add_argument(
        "--periods",
        type=within(2, 1000, int),
        default=6,
        help="steady periods of each trajectory (default %(default)s)",
    )
    parser.add_argument(
        "--design-time", type=within(1.0, 3600.0), default=24.0, metavar="S", help="to optimise the excitations"
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
    """Design, excite, record, identify, doubt, add, validate."""
    from robot_ident.cli.demo_experiment import design_motions, record
    from robot_ident.robot import load_robot

    started = time.monotonic()
    if args.periods < 2:
        raise InputError(f"--periods {args.periods}: at least 2 are needed to tell the noise")
    if importlib.util.find_spec("rclpy") is None:
        raise InputError("the demo needs ROS 2; install it with pip install '.[ros]' in the checkout")
    folder = _folder(Path(args.folder), args.force)
    robot = load_robot()
    tell(f"A simulated {robot.name} is excited, recorded, identified and doubted; everything is kept in {folder}/")
    runs = design_motions(robot, folder, periods=args.periods, seconds=args.design_time, seed=args.seed)
    record(runs, folder, seed=args.seed, hidden=args.hidden)
    models, found, validations = _identify(robot, runs, folder)
    page = _write_page(runs, len(models), folder)
    seconds = time.monotonic() - started
    truth = _truth(models[-1], args.hidden)
    if args.json:
        print_json({**_to_dict(models, found, validations, truth, runs, seconds), "report": str(page)})
        return 0
    say(_summary(models, found, validations, truth))
    say(f"\nThe report: {page} (open it in a browser), beside excitations, recordings (rosbag2 MCAP), models and logs.")
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


def _identify(robot: Robot, runs: list[Run], folder: Path) -> tuple[list[Model], Diagnosis, list[Validation]]:
    """Identify the paper's model, diagnose it, add what is missing, validate both on the unseen motion."""
    from robot_ident.bags import read_recording
    from robot_ident.diagnosis.diagnose import diagnose
    from robot_ident.estimation.identify import estimate
    from robot_ident.estimation.validate import validate
    from robot_ident.model.model_file import write_model
    from robot_ident.model.structure import Structure
    from robot_ident.provenance import provenance
    from robot_ident.recording.process import process

    tell("[3/5] Identifying the paper's 21 parameters from the recordings, by weighted least squares")
    bags = [str(motion.bag) for motion in runs[:-1]]
    measurements = [process(read_recording(bag), robot) for bag in bags]
    models = [estimate(measurements, Structure.build(robot))]
    tell("[4/5] Doubting: is what is left over noise, and if not, which effect is missing?")
    found = diagnose(measurements, models[0].structure)
    if found.missing:
        models.append(estimate(measurements, Structure.build(robot, [suspect.effect for suspect in found.missing])))
    tell("[5/5] Validating on 20 points with full stops, a motion that no model has seen")
    unseen = read_recording(runs[-1].bag)
    models = [replace(model, provenance=provenance(bags, {"demo": True})) for model in models]
    for number, model in enumerate(models, 1):
        write_model(model, folder / f"model_{number}.yaml")
    return models, found, [validate(model, unseen) for model in models]


def _write_page(runs: list[Run], count: int, folder: Path) -> Path:
    """Write the report on the models beside the recordings, from what is on disk."""
    import shlex

    from robot_ident.model.model_file import read_model
    from robot_ident.report.findings import gather
    from robot_ident.report.report import write_report
    from robot_ident.report.sources import read_excitations, read_sources

    page, paths = folder / "report.html", [str(folder / f"model_{number}.yaml") for number in range(1, count + 1)]
    models = [(path, read_model(path)) for path in paths]
    *fitted, unseen = [str(motion.bag) for motion in runs]
    played = [str(motion.file) for motion in runs[:-1]]
    words = ["robot_ident", "report", *paths, "--bag", *fitted, "--validation", unseen]
    words += [word for file in played for word in ("--trajectory", file)]
    found = gather(
        models,
        read_sources(fitted, models[0][1]),
        read_sources([unseen], models[0][1]),
        read_excitations(played, []),
        command=shlex.join([*words, "-o", str(page)]),
    )
    write_report(page, found)
    return page


def _truth(model: Model, hidden: Sequence[str]) -> Array:
    """Return the true values [p] of a model's parameters, those of the hidden effects included."""
    truth = model.structure.true_values()
    for effect in hidden:
        label, _, value = effect.partition(":")
        if label in model.structure.names and value:
            truth[model.structure.names.index(label)] = float(value.rpartition("=")[2])
    return truth


def _summary(models: list[Model], found: Diagnosis, validations: list[Validation], truth: Array) -> str:
    from robot_ident.cli.identify import fit_table

    model = models[-1]
    rows = [
        (p.name, f"{t:.3f}", f"{v:.3f}", f"{s:.3f}", f"{(v - t) / s:+.2f}", p.unit, p.meaning)
        for p, t, v, s in zip(model.structure.parameters, truth, model.linear, model.std, strict=False)
    ]
    names = ["the paper's model", *(f"the model with {', '.join(s.label for s in found.missing)}" for _ in models[1:])]
    lines = ["The paper's model on the recordings it was fitted to, beside the noise told by the periods alone:"]
    lines += [fit_table(models[0].robot, models[0].residual), "", f"Verdict: {found.in_words}"]
    for suspect in found.missing:
        share = f"{100 * suspect.explained:.0f} % of the excess on trajectories left out of the fit"
        lines.append(f"  {suspect.label} explains {share}")
    for name, validation in zip(names, validations, strict=True):
        lines += [
            "",
            f"Validation of {name} on 20 points (moving, 10 Hz low pass):",
            fit_table(model.robot, validation.residual),
        ]
    lines += ["", f"Parameters of {names[-1]}:"]
    lines += [table(("parameter", "true", "estimate", "sigma", "error/sigma", "unit", "meaning"), rows)]
    lines += [
        "",
        f"Its residual beside the noise, {model.noise.periods} averaged periods:",
        fit_table(model.robot, model.residual),
    ]
    return "\n".join(lines)


def _to_dict(
    models: list[Model], found: Diagnosis, validations: list[Validation], truth: Array, runs: list[Run], seconds: float
) -> dict[str, Any]:
    return {
        "schema": "robot_ident/demo/1",
        "seconds": seconds,
        "folder": str(runs[0].file.parent),
        "bags": [str(motion.bag) for motion in runs],
        "true_values": dict(zip(models[-1].structure.names, truth.tolist(), strict=True)),
        "model": models[-1].to_dict(),
        "models": [model.to_dict() for model in models],
        "diagnosis": found.to_dict(),
        "validation": validations[-1].to_dict(),
    }

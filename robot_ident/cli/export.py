"""`robot_ident export`."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from robot_ident.cli.output import add_json, print_json, say, table, tell, within

if TYPE_CHECKING:
    from robot_ident.export.exported import Exported
    from robot_ident.model.model import Model


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's options."""
    parser.add_argument("model", metavar="model.yaml", help="an identified model")
    form = parser.add_mutually_exclusive_group(required=True)
    form.add_argument("--urdf", metavar="F", help="the robot's URDF with the identified inertias and joint friction")
    form.add_argument("--mjcf", metavar="F", help="a MuJoCo model, rotor inertias included")
    form.add_argument("--c", metavar="DIR", help="folder with C code of torque, gravity and friction")
    parser.add_argument(
        "--smoothing",
        type=within(1e-9, 1e3),
        default=0.01,
        metavar="V",
        help="C code: speed below which dry friction is smoothed, rad/s or m/s (default %(default)s)",
    )
    parser.add_argument(
        "--validation", metavar="BAG", help="a recording along which the torque of what is left out is measured"
    )
    parser.add_argument("--topic", metavar="T", help="topic of the joint states")
    parser.add_argument("--force", action="store_true", help="replace what is there")
    add_json(parser)


def run(args: argparse.Namespace) -> int:
    """Write a model in another format and say what the format can't carry."""
    from robot_ident.errors import InputError
    from robot_ident.files import refuse_existing, write_text
    from robot_ident.model.model_file import read_model

    form = next(name for name in FORMATS if getattr(args, name))
    target = Path(getattr(args, form))
    if form == "c" and target.is_file():
        raise InputError(f"--c {target}: a folder is needed, this is a file")
    if not (form == "c" and target.is_dir()):
        refuse_existing(target, force=args.force)
    model = read_model(args.model)
    if model.robot.ampere_joints:
        raise InputError(
            f"{args.model}: the gains of {', '.join(model.robot.ampere_joints)} are not known, so that what it says of"
            " them carries the unit A: nothing to export; a recording with a known payload beside their axes would tell"
            " them, or a torque_constant in the robot YAML"
        )
    made = FORMATS[form](model, args)
    cost = _cost(model, made, args)
    if "" in made.files:
        write_text(target, made.files[""], force=args.force)
    else:
        _write_folder(target, made.files, force=args.force)
    if args.json:
        left = [{"effect": label, "rms": cost.get(label)} for label in made.left]
        data = {
            "schema": "robot_ident/export/1",
            "format": form,
            "path": str(target),
            "files": [str(target / name) for name in sorted(made.files)],
        }
        print_json({**data, "carried": list(made.carried), "left_out": left, "notes": list(made.notes)})
        return 0
    for note in made.notes:
        tell(note)
    say(f"carried: the links{''.join(f', {label}' for label in made.carried)}")
    if made.left:
        say(f"left out: {', '.join(made.left)}")
    if cost:
        say(table(("left out", *model.robot.joints), [(label, *rms.values()) for label, rms in cost.items()]))
        say("Nm (N) rms along the recording")
    say(f"written: {target}")
    return 0


def _urdf(model: Model, args: argparse.Namespace) -> Exported:
    from robot_ident.export.dynamics import Dynamics
    from robot_ident.export.urdf import to_urdf

    return to_urdf(Dynamics.of(model))


def _mjcf(model: Model, args: argparse.Namespace) -> Exported:
    from robot_ident.export.dynamics import Dynamics
    from robot_ident.export.mjcf import to_mjcf

    return to_mjcf(Dynamics.of(model))


def _c(model: Model, args: argparse.Namespace) -> Exported:
    from robot_ident.export.c_code import to_c

    return to_c(model, args.smoothing)


FORMATS: dict[str, Callable[[Model, argparse.Namespace], Exported]] = {"urdf": _urdf, "mjcf": _mjcf, "c": _c}


def _cost(model: Model, made: Exported, args: argparse.Namespace) -> dict[str, dict[str, float]]:
    """Return the rms torque by joint of each effect that is left out; nothing without a recording."""
    if not args.validation:
        return {}
    from robot_ident.bags import read_for
    from robot_ident.export.left_out import torque_of
    from robot_ident.recording.measurement import Processing
    from robot_ident.recording.process import process

    processing = Processing(**dict(model.processing)) if model.processing else Processing()
    measured = process(read_for(args.validation, model.robot, topic=args.topic), model.robot, processing)
    found = torque_of(model, made.left, measured.motion)
    return {label: dict(zip(model.robot.joints, map(float, rms), strict=True)) for label, rms in found.items()}


def _write_folder(target: Path, files: Mapping[str, str], *, force: bool) -> None:
    """Write the files of an export into a folder: a new one whole, into one that is there each of them whole."""
    from robot_ident.files import refuse_existing, whole, write_text

    if target.is_dir():
        for name in files:
            refuse_existing(target / name, force=force)
        for name, text in files.items():
            write_text(target / name, text, force=force)
        return
    with whole(target, force=force) as draft:
        draft.mkdir()
        for name, text in files.items():
            (draft / name).write_text(text, encoding="utf-8")

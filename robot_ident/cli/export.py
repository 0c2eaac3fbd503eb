"""`robot_ident export`."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from robot_ident.bags import read_for
from robot_ident.cli.identify import fit_table
from robot_ident.cli.output import print_json, say, say_written, table, tell
from robot_ident.errors import InputError
from robot_ident.estimation.prediction import measured_for
from robot_ident.estimation.validation import residual_on, unusable
from robot_ident.export.exported import Dynamics, Exported, torque_of
from robot_ident.export.inertias import impossible
from robot_ident.export.to_c import to_c
from robot_ident.export.to_mjcf import to_mjcf
from robot_ident.export.to_urdf import to_urdf
from robot_ident.files import refuse_existing, whole, write_text
from robot_ident.model.model import Fit, Model
from robot_ident.model.model_file import read_model

_UNCERTAIN = 5.0  # standard deviations by which parameters may be impossible and do no harm to a torque


def run(args: argparse.Namespace) -> None:
    """Write a model in another format and say what the format can't carry."""
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
    if model.trouble and not args.anyway:
        raise InputError(f"{args.model}: {model.trouble} (--anyway writes it all the same)")
    made = FORMATS[form](model, args)
    held = _held_against(model, made, args)
    if held.trouble and not args.anyway:
        raise InputError(f"{args.model}: {held.trouble} (--anyway writes it all the same)")
    notes = model.leading((*made.notes, held.trouble or ""))
    if "" in made.files:
        write_text(target, made.files[""], force=args.force)
    else:
        _write_folder(target, made.files, force=args.force)
    if args.json:
        left = [{"effect": label, "rms": held.left_out.get(label)} for label in made.left]
        files = [str(target / name) for name in sorted(made.files)]
        data = {"schema": "robot_ident/export/1", "format": form, "path": str(target), "files": files}
        residual = {joint: asdict(one) for joint, one in held.residual.items()} if args.validation else None
        more = {"carried": list(made.carried), "left_out": left, "residual": residual, "notes": list(notes)}
        print_json({**data, **more})
        return
    tell(*notes)
    say(f"exported: the links{''.join(f', {label}' for label in made.carried)}")
    if made.left:
        say(f"not exported: {', '.join(made.left)}")
    if held.left_out:
        rows = [(label, *rms.values()) for label, rms in held.left_out.items()]
        say(table(("not exported", *model.robot.joints), rows))
        say("Nm (N) rms along the recording")
    if held.residual:
        say(fit_table(model.robot, held.residual))
        say("error of the complete model along the recording")
    say_written(target)


def _of_dynamics(model: Model, args: argparse.Namespace) -> Exported:
    return (to_urdf if args.urdf else to_mjcf)(Dynamics.of(model))


def _c(model: Model, args: argparse.Namespace) -> Exported:
    made = to_c(model, args.smoothing)
    found = None if model.physical_inertias is not None else impossible(model)
    if found is None:
        return made
    sigmas, why = found
    if sigmas > _UNCERTAIN and not args.anyway:
        raise InputError(f"{args.model}: {why}; --anyway writes the C code all the same")
    return replace(made, notes=(*made.notes, f"{why}; they are {sigmas:.2g} standard deviations from some that can"))


FORMATS: dict[str, Callable[[Model, argparse.Namespace], Exported]] = {
    "urdf": _of_dynamics,
    "mjcf": _of_dynamics,
    "c": _c,
}


@dataclass(frozen=True)
class _Held:
    """A model along a recording: its error by joint, the rms torque by joint of each effect that is left out, and why
    it can't be used; empty without a recording.
    """

    residual: Mapping[str, Fit]
    left_out: Mapping[str, Mapping[str, float]]
    trouble: str | None


def _held_against(model: Model, made: Exported, args: argparse.Namespace) -> _Held:
    if not args.validation:
        return _Held({}, {}, None)
    measured = measured_for(model, read_for(args.validation, model.robot, topic=args.topic))
    residual = residual_on(model, measured)
    left = torque_of(model, made, measured.motion)
    by_joint = {label: dict(zip(model.robot.joints, map(float, rms), strict=True)) for label, rms in left.items()}
    return _Held(residual, by_joint, unusable(model, args.validation, residual))


def _write_folder(target: Path, files: Mapping[str, str], *, force: bool) -> None:
    """Write the files of an export into a folder: a new one whole, into one that is there each of them whole."""
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

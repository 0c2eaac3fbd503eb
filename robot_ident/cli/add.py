"""`robot_ident add`."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from robot_ident.cli.output import print_json, say, table
from robot_ident.errors import InputError

if TYPE_CHECKING:
    from robot_ident.cli.loop import Inputs
    from robot_ident.model.model import Model


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's options."""
    from robot_ident.cli.loop import add_common

    parser.add_argument("model", metavar="model.yaml", help="the model to extend")
    parser.add_argument("effects", nargs="+", metavar="NAME@JOINT", help="effects to add")
    parser.add_argument("--bag", nargs="+", required=True, metavar="BAG", help="recordings to fit")
    parser.add_argument("-o", "--output", metavar="MODEL2", help="the extended model to write")
    parser.add_argument("--force", action="store_true", help="replace what is there")
    add_common(parser)


def run(args: argparse.Namespace) -> int:
    """Add effects to a model, refit, and print the error before and after."""
    from robot_ident.cli.loop import read_inputs
    from robot_ident.effects import make_effect
    from robot_ident.estimation.extend import extend
    from robot_ident.files import refuse_existing
    from robot_ident.model.model_file import is_model, write_model

    if args.output:
        refuse_existing(args.output, force=args.force)
    if not is_model(args.model):
        raise InputError(f"{args.model}: not a model; make one by robot_ident identify ... -o model.yaml")
    inputs = read_inputs([args.model, *args.bag], args.validation, args.topic)
    effects = [make_effect(label, inputs.models[0].robot) for label in args.effects]
    steps = extend(inputs.models[0], inputs.measurements, effects)
    if args.output:
        write_model(steps[-1], args.output, force=args.force)
    if args.json:
        print_json(_to_dict(inputs, steps))
        return 0
    say(staircase(inputs, steps))
    say()
    names = {e.label for e in effects}
    for p, value, std in zip(steps[-1].parameters, steps[-1].values, steps[-1].std, strict=True):
        if f"{p.effect}@{p.joint}" in names or (p.joint is None and p.effect in names):
            say(f"{p.name} = {value:.4g} ± {std:.2g} {p.unit}".rstrip())
    if args.output:
        say(f"written: {args.output}")
    return 0


def validation_errors(model: Model, inputs: Inputs) -> dict[str, float] | None:
    """Return the mean square error by joint over the validation recordings, (Nm)^2; None where there are none."""
    import numpy as np

    from robot_ident.estimation.extend import mean_square_errors

    if not inputs.validation:
        return None
    total = np.mean([mean_square_errors(model, measured) for measured in inputs.validation], axis=0)
    return {joint: float(value) for joint, value in zip(model.robot.joints, total, strict=True)}


def staircase(inputs: Inputs, steps: Sequence[Model]) -> str:
    """Return the falling error, a line a joint and model, beside the noise floor."""
    robot = inputs.models[0].robot
    rows: list[tuple[object, ...]] = []
    unseen = [validation_errors(model, inputs) for model in steps]
    for number, joint in enumerate(robot.joints):
        for place, model in enumerate(steps):
            label = "as it was" if place == 0 else f"+ {model.structure.labels[-1]}"
            fit, beyond = model.residual[joint], unseen[place]
            floor = None if fit.noise_variance is None else fit.noise_variance**0.5
            row = (joint if place == 0 else "", label, fit.rms, *(() if beyond is None else (beyond[joint] ** 0.5,)))
            rows.append((*row, floor, robot.torque_unit(number)))
    validation = ("validation rms",) if inputs.validation else ()
    return table(("joint", "model", "rms", *validation, "noise rms", "unit"), rows)


def _to_dict(inputs: Inputs, steps: Sequence[Model]) -> dict[str, Any]:
    before, after = steps[0], steps[-1]
    joints = before.robot.joints
    return {
        "schema": "robot_ident/add/1",
        "added": list(after.structure.labels[len(before.structure.labels) :]),
        "residual_mse_before": {joint: before.residual[joint].mse for joint in joints},
        "residual_mse_after": {joint: after.residual[joint].mse for joint in joints},
        "noise_variance": {joint: after.residual[joint].noise_variance for joint in joints},
        "validation_mse_before": validation_errors(before, inputs),
        "validation_mse_after": validation_errors(after, inputs),
        "model": after.to_dict(),
    }

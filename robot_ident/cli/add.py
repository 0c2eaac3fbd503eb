"""`robot_ident add`."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from robot_ident.cli.output import print_json, say, table
from robot_ident.errors import InputError

if TYPE_CHECKING:
    from robot_ident.cli.loop import Inputs
    from robot_ident.effects import Effect
    from robot_ident.model.model import Model
    from robot_ident.motion import Array
    from robot_ident.recording.measurement import Measurement


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
    from robot_ident.cli.effects_from import register_effects
    from robot_ident.cli.loop import is_model, read_inputs
    from robot_ident.effects import make_effect
    from robot_ident.files import refuse_existing
    from robot_ident.model.model_file import write_model

    if args.output:
        refuse_existing(args.output, force=args.force)
    register_effects(args)
    if not is_model(args.model):
        raise InputError(f"{args.model}: not a model; make one by robot_ident identify ... -o model.yaml")
    inputs = read_inputs([args.model, *args.bag], args.validation, args.topic)
    effects = [make_effect(label, inputs.models[0].robot) for label in args.effects]
    steps = extend(inputs, effects)
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
            say(f"{p.name} = {value:.4g} +- {std:.2g} {p.unit}".rstrip())
    if args.output:
        say(f"written: {args.output}")
    return 0


def extend(inputs: Inputs, effects: Sequence[Effect]) -> list[Model]:
    """Return the model refitted as it is, then with one effect more each time."""
    from robot_ident.estimation.identify import estimate
    from robot_ident.model.structure import Structure
    from robot_ident.recording.measurement import Processing

    model = inputs.models[0]
    usual = Structure.build(model.robot).labels
    held = [effect for effect in model.structure.effects if effect.label not in usual]
    processing = Processing(**dict(model.processing)) if model.processing else Processing()
    steps = []
    for count in range(len(effects) + 1):
        structure = Structure.build(model.robot, [*held, *effects[:count]])
        fitted = estimate(inputs.measurements, structure, estimator=model.estimator, processing=processing)
        steps.append(replace(fitted, provenance={**model.provenance, "added": [e.label for e in effects[:count]]}))
    return steps


def errors(model: Model, measured: Measurement) -> Array:
    """Return the mean square error [n] of a model on a measurement, (Nm)^2."""
    import numpy as np

    error = measured.passed(measured.torque - model.predict(measured.motion))
    used = measured.used[measured.rows]
    return np.asarray(np.sum(np.where(used, error**2, 0.0), axis=0) / np.maximum(used.sum(axis=0), 1))


def staircase(inputs: Inputs, steps: Sequence[Model]) -> str:
    """Return the falling error, a line a model, beside the noise floor."""
    import numpy as np

    robot = inputs.models[0].robot
    rows: list[tuple[object, ...]] = []
    for number, model in enumerate(steps):
        label = "as it was" if number == 0 else f"+ {model.structure.labels[-1]}"
        train = [model.residual[joint].rms for joint in robot.joints]
        unseen: list[float] = []
        if inputs.validation:
            unseen = list(np.sqrt(np.mean([errors(model, m) for m in inputs.validation], axis=0)))
        rows.append((label, *train, *unseen))
    floor = [model.residual[joint].noise_variance for joint in robot.joints]
    rows.append(
        ("noise", *(None if v is None else v**0.5 for v in floor), *([None] * robot.n if inputs.validation else ()))
    )
    header = [f"{joint} rms" for joint in robot.joints]
    header += [f"validation {joint}" for joint in robot.joints] if inputs.validation else []
    return table(("model", *header), rows)


def _to_dict(inputs: Inputs, steps: Sequence[Model]) -> dict[str, Any]:
    before, after = steps[0], steps[-1]
    joints = before.robot.joints

    def mean(model: Model) -> dict[str, float] | None:
        if not inputs.validation:
            return None
        return {
            n: float(sum(errors(model, m)[j] for m in inputs.validation) / len(inputs.validation))
            for j, n in enumerate(joints)
        }

    return {
        "schema": "robot_ident/add/1",
        "added": list(after.structure.labels[len(before.structure.labels) :]),
        "residual_mse_before": {joint: before.residual[joint].mse for joint in joints},
        "residual_mse_after": {joint: after.residual[joint].mse for joint in joints},
        "noise_variance": {joint: after.residual[joint].noise_variance for joint in joints},
        "validation_mse_before": mean(before),
        "validation_mse_after": mean(after),
        "model": after.to_dict(),
    }

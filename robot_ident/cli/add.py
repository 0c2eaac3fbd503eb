"""`robot_ident add`."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import Any

from robot_ident.cli.output import print_json, say, say_written, tell
from robot_ident.cli.steps import staircase
from robot_ident.errors import InputError
from robot_ident.model.model_file import is_model, read_model, write_model
from robot_ident.workflow.inputs import read_inputs
from robot_ident.workflow.steps import Step, steps_of


def run(args: argparse.Namespace) -> None:
    """Add effects to a model, refit, and print the error before and after."""
    if not is_model(args.model):
        raise InputError(f"{args.model}: not a model; make one by robot_ident identify ... -o model.yaml")
    read_model(args.model).structure.with_further(args.effects)  # what it refuses, it refuses before it reads BAG
    inputs = read_inputs([args.model, *args.bag], args.validation, args.topic)
    extended = inputs.models[0].structure.with_further(args.effects)
    effects = extended.effects[len(inputs.models[0].structure.effects) :]
    notes = extended.notes[len(inputs.models[0].structure.notes) :]
    steps = steps_of(inputs, effects)
    last = steps[-1].model
    if args.output:
        write_model(last, args.output, force=args.force)
    if args.json:
        print_json(_to_dict(steps, notes))
        return
    tell(*steps[-1].troubles, *notes)
    say(staircase(steps), "")
    names = {e.label for e in effects}
    for p, value, std, at_bound in zip(last.parameters, last.values, last.std, last.at_bound, strict=True):
        if f"{p.effect}@{p.joint}" in names or (p.joint is None and p.effect in names):
            spread = f" ± {std:.2g}" if std and not at_bound else ""
            say(f"{p.name} = {value:.4g}{spread} {p.unit}".rstrip() + (" (at its bound)" if at_bound else ""))
    for one in last.gains or ():
        say(f"gain of {one['joint']} = {one['value']:.4g} ± {one['std']:.2g} {one['unit']}")
    say_written(args.output)


def _to_dict(steps: Sequence[Step], notes: Sequence[str]) -> dict[str, Any]:
    before, after = steps[0].model, steps[-1].model
    joints = before.robot.joints
    return {
        "schema": "robot_ident/add/1",
        "added": list(after.structure.labels[len(before.structure.labels) :]),
        "residual_mse_before": {joint: before.residual[joint].mse for joint in joints},
        "residual_mse_after": {joint: after.residual[joint].mse for joint in joints},
        "noise_variance": {joint: after.residual[joint].noise_variance for joint in joints},
        "validation_mse_before": steps[0].unseen,
        "validation_mse_after": steps[-1].unseen,
        "model": after.to_dict(),
        "notes": [*steps[-1].troubles, *notes],
    }

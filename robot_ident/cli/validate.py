"""`robot_ident validate`."""

from __future__ import annotations

import argparse
from dataclasses import replace

from robot_ident.bags import read_for
from robot_ident.cli.identify import fit_table
from robot_ident.cli.output import print_json, say, tell
from robot_ident.errors import CheckFailed
from robot_ident.estimation.validation import validate
from robot_ident.model.model_file import read_model
from robot_ident.workflow.inputs import fitted_to


def run(args: argparse.Namespace) -> None:
    """Validate and print the residual of every joint."""
    model = read_model(args.model)
    recording = read_for(args.bag, model.robot, topic=args.topic)
    result = validate(model, recording, low_pass=args.low_pass)
    seen = fitted_to(model, args.bag, recording)
    if seen:
        nothing = f"{seen}, so it validates nothing; give an independent one"
        result = replace(result, notes=model.leading((nothing, *result.notes)))
    if args.json:
        print_json(result.to_dict())
    else:
        tell(*result.notes)
        say(f"residual while moving, low-pass filter at {result.low_pass_hz:.3g} Hz")
        say(fit_table(model.robot, result.residual))
        if result.standstill:
            say("\nresidual near standstill, where stiction leaves the torque indeterminate")
            say(fit_table(model.robot, result.standstill))
        if result.trouble:
            tell(result.trouble)
    worst = max(result.residual, key=lambda joint: result.residual[joint].rms)
    if args.max_rms is not None and result.residual[worst].rms > args.max_rms:
        unit = model.robot.torque_unit(model.robot.joint_index(worst))
        raise CheckFailed(
            f"{worst}: residual of {result.residual[worst].rms:.4g} {unit} rms exceeds --max-rms {args.max_rms:g}"
        )

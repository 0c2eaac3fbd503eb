"""`robot_ident predict`."""

from __future__ import annotations

import argparse

import numpy as np

from robot_ident.bags import read_for, write_prediction
from robot_ident.cli.output import print_json, say, say_written, table, tell
from robot_ident.estimation.prediction import Prediction, predict
from robot_ident.model.model_file import read_model
from robot_ident.workflow.inputs import predict_planned


def run(args: argparse.Namespace) -> None:
    """Write the model's torque along a recording."""
    model = read_model(args.model)
    planned = predict_planned(args.bag, model)
    found = planned or predict(model, read_for(args.bag, model.robot, topic=args.topic))
    write_prediction(args.output, found, force=args.force)
    joints = {joint: _of_joint(found, k) for k, joint in enumerate(found.joints)}
    if args.json:
        data = {"schema": "robot_ident/predict/1", "path": str(args.output), "samples": len(found.t)}
        print_json({**data, "joints": joints, "notes": list(found.notes)})
        return
    tell(*found.notes)
    rows = [(name, *values.values()) for name, values in joints.items()]
    say(table(("joint", "torque rms", "largest", "sigma rms", "unexplained rms", "95 % band rms +-", "unit"), rows))
    say(
        "sigma: from the parameters' uncertainty; unexplained: residual over the noise in the identification recordings"
    )
    say_written(args.output)


def _of_joint(found: Prediction, k: int) -> dict[str, float | str]:
    """Return a joint's figures, and their unit."""
    torque, std, band = found.torque[:, k], found.std[:, k], found.band[:, k]
    return {
        "torque_rms": float(np.sqrt(np.mean(torque**2))),
        "largest": float(np.abs(torque).max()),
        "std_rms": float(np.sqrt(np.mean(std**2))),
        "misfit_rms": float(found.misfit[k]),
        "band_rms": float(np.sqrt(np.mean(band**2))),
        "unit": found.units[k],
    }

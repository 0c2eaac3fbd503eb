"""`robot_ident predict`."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from robot_ident.cli.output import add_json, add_output, print_json, say, table, tell

if TYPE_CHECKING:
    from robot_ident.estimation.predict import Prediction


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's options."""
    parser.add_argument("model", metavar="model.yaml", help="an identified model")
    parser.add_argument("bag", metavar="BAG", help="a recording whose motion counts")
    parser.add_argument("--topic", metavar="T", help="topic of the joint states")
    add_output(parser, "OUT", "prediction to write: .npz, .csv, .mcap or a folder", required=True)
    add_json(parser)


def run(args: argparse.Namespace) -> int:
    """Write the model's torque along a recording."""
    from robot_ident.bags import read_recording, write_prediction
    from robot_ident.estimation.predict import predict
    from robot_ident.files import refuse_existing
    from robot_ident.model.model_file import read_model

    refuse_existing(args.output, force=args.force)
    model = read_model(args.model)
    found = predict(model, read_recording(args.bag, topic=args.topic))
    write_prediction(args.output, found, force=args.force)
    joints = {joint: _of_joint(found, k) for k, joint in enumerate(found.joints)}
    if args.json:
        data = {"schema": "robot_ident/predict/1", "path": str(args.output), "samples": len(found.t)}
        print_json({**data, "joints": joints, "notes": list(found.notes)})
        return 0
    for note in found.notes:
        tell(note)
    units = [model.robot.torque_unit(k) for k in range(model.robot.n)]
    rows = [(name, *values.values(), unit) for (name, values), unit in zip(joints.items(), units, strict=True)]
    say(table(("joint", "torque rms", "largest", "sigma rms", "misfit rms", "95 % band +-", "unit"), rows))
    say("sigma: by the parameters' uncertainty; misfit: what the model left unexplained where it was identified")
    say(f"written: {args.output}")
    return 0


def _of_joint(found: Prediction, k: int) -> dict[str, float]:
    """Return a joint's figures [Nm]."""
    import numpy as np

    torque, std, band = found.torque[:, k], found.std[:, k], found.band[:, k]
    return {
        "torque_rms": float(np.sqrt(np.mean(torque**2))),
        "largest": float(np.abs(torque).max()),
        "std_rms": float(np.sqrt(np.mean(std**2))),
        "misfit_rms": float(found.misfit[k]),
        "band_mean": float(band.mean()),
    }

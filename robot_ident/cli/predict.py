"""`robot_ident predict`."""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from robot_ident.bags import read_for, write_prediction
from robot_ident.cli.output import print_json, say, say_written, table, tell
from robot_ident.errors import InputError
from robot_ident.estimation.prediction import Prediction, predict, predict_motion, refuse_elsewhere
from robot_ident.model.model import Model
from robot_ident.model.model_file import read_model
from robot_ident.signals.motion import Motion
from robot_ident.trajectories.excitation import Excitation
from robot_ident.trajectories.point_to_point import load_motion

_SAMPLE_RATE = 150.0  # Hz at which moves from point to point are looked at
_MOST_SAMPLES = 1_000_000  # of a planned motion: the columns of every one are held


def run(args: argparse.Namespace) -> int:
    """Write the model's torque along a recording."""
    model = read_model(args.model)
    planned = _planned(args.bag, model)
    found = planned or predict(model, read_for(args.bag, model.robot, topic=args.topic))
    write_prediction(args.output, found, force=args.force)
    joints = {joint: _of_joint(found, k) for k, joint in enumerate(found.joints)}
    if args.json:
        data = {"schema": "robot_ident/predict/1", "path": str(args.output), "samples": len(found.t)}
        print_json({**data, "joints": joints, "notes": list(found.notes)})
        return 0
    tell(*found.notes)
    units = [model.robot.torque_unit(k) for k in range(model.robot.n)]
    rows = [(name, *values.values(), unit) for (name, values), unit in zip(joints.items(), units, strict=True)]
    say(table(("joint", "torque rms", "largest", "sigma rms", "unexplained rms", "95 % band rms +-", "unit"), rows))
    say(
        "sigma: from the parameters' uncertainty; unexplained: residual over the noise in the identification recordings"
    )
    say_written(args.output)
    return 0


def _planned(path: str, model: Model) -> Prediction | None:
    """Return the torque along a motion in a YAML, None where the file is none.

    A motion of more joints than the model has must leave the others where the model holds them.
    """
    if Path(path).suffix not in (".yaml", ".yml"):
        return None
    motion = load_motion(path)
    rate = motion.sample_rate if isinstance(motion, Excitation) else _SAMPLE_RATE
    seconds = motion.period if isinstance(motion, Excitation) else motion.duration
    if not seconds * rate <= _MOST_SAMPLES:
        raise InputError(
            f"{path}: a motion of {seconds:.4g} s at {rate:g} Hz is too long: at most {_MOST_SAMPLES / rate:.4g} s"
        )
    if isinstance(motion, Excitation):
        t, state = motion.times(), motion.samples()
    else:
        t = np.arange(0.0, motion.duration, 1.0 / _SAMPLE_RATE)
        state = motion.reference(t)
    missing = [name for name in model.robot.joints if name not in motion.joints]
    if missing:
        raise InputError(f"{path}: joint {missing[0]!r} is missing; the motion has {', '.join(motion.joints)}")
    others = [k for k, name in enumerate(motion.joints) if name not in model.robot.joints]
    if np.any(state.dq[:, others]):
        raise InputError(f"{path}: {motion.joints[others[0]]} moves, which the model holds")
    refuse_elsewhere(model, path, {motion.joints[k]: float(state.q[0, k]) for k in others})
    pick = [motion.joints.index(name) for name in model.robot.joints]
    chosen = Motion(state.q[:, pick], state.dq[:, pick], state.ddq[:, pick], state.dt, state.periodic)
    return predict_motion(model, t, chosen)


def _of_joint(found: Prediction, k: int) -> dict[str, float]:
    """Return a joint's figures [Nm]."""
    torque, std, band = found.torque[:, k], found.std[:, k], found.band[:, k]
    return {
        "torque_rms": float(np.sqrt(np.mean(torque**2))),
        "largest": float(np.abs(torque).max()),
        "std_rms": float(np.sqrt(np.mean(std**2))),
        "misfit_rms": float(found.misfit[k]),
        "band_rms": float(np.sqrt(np.mean(band**2))),
    }

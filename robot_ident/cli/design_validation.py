"""`robot_ident design --validation-motion`: the motion on which a model is validated."""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from typing import TYPE_CHECKING

from robot_ident.cli.design_kinds import design_json, refuse_with
from robot_ident.cli.output import margin_table, print_json, refuse_unchecked, say, say_unchecked

if TYPE_CHECKING:
    from robot_ident.design.target import Target

# Options that ask for an excitation: a validation motion has neither harmonics nor a criterion.
_NOT_WITH = (
    *(
        "--waypoints",
        "--tell",
        "--only",
        "--iterate",
        "--prior",
        "--symmetric",
        "--bandwidth",
        "--harmonics",
        "--starts",
    ),
    *("--time-limit", "--bound", "--page", "--precision", "--joints", "--trajectories"),
)


def run_validation(args: argparse.Namespace, target: Target, files: Sequence[str]) -> int:
    """Draw a certified motion through random points with full stops, and write it (Swevers et al. 1997, section V)."""
    import numpy as np

    from robot_ident.design.criteria import evaluate_rows
    from robot_ident.limits.certifier import certify
    from robot_ident.planning.validation_motion import validation_motion

    refuse_with(args, "--validation-motion", _NOT_WITH)
    started = time.monotonic()
    motion = validation_motion(target.robot, seed=args.seed)
    margins = certify(motion, target.robot)
    t = np.arange(int(motion.duration * args.sample_rate) + 1) / args.sample_rate
    columns = target.structure.columns(motion.reference(t), target.values) / np.sqrt(target.torque_variance)[:, None]
    values = evaluate_rows(np.asarray(columns.reshape(-1, columns.shape[2])))
    for file in files:
        motion.write(file, force=args.force)
    points = len(motion.points)
    if args.json:
        seconds, names = time.monotonic() - started, target.structure.names
        drawn = {"points": points, "duration": motion.duration}
        print_json(design_json(files, values, names, margins, seconds, target.notes, validation=drawn))
        refuse_unchecked(args, margins)
        return 0
    say_unchecked(margins)
    say(
        f"{points} random points, {motion.duration:.4g} s: maximum acceleration, then velocity, full stop at each;"
        " it enters no fit (validate, --validation)"
    )
    say(margin_table(margins))
    for file in files:
        say(f"written: {file}")
    refuse_unchecked(args, margins)
    return 0

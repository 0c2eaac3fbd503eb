"""`robot_ident design --from BAG`: within the envelope of what the robot has run already."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from robot_ident.recording.recording import Recording
    from robot_ident.robot import Robot
    from robot_ident.signals.motion import Array

_BANDWIDTH = 10.0  # Hz of the derivatives of what does not repeat: beyond, noise would widen the envelope
_POINTS = 4000  # of a recording at which the tool is looked at


def within_runs(args: argparse.Namespace, robot: Robot, whole: Robot) -> Robot:
    """Return the robot with the envelope of the recordings of --from as its limits; itself where there are none.

    whole: the robot with all its joints, of which `robot` may hold some: its tool has been where all of them took it.
    """
    if not args.run_before:
        return robot
    import numpy as np

    from robot_ident.bags import read_for
    from robot_ident.excitation.envelope import within_envelope
    from robot_ident.recording.measurement import Processing
    from robot_ident.recording.process import process
    from robot_ident.signals.motion import Motion

    motions, places = [], []
    for bag in args.run_before:
        recording = read_for(bag, robot)
        measured = process(recording, robot, Processing(derivative_bandwidth=_BANDWIDTH), motion_only=True)
        edge = 0 if measured.base_frequency is not None else round(1.0 / (_BANDWIDTH * measured.dt))
        kept = measured.motion[slice(edge, measured.motion.samples - edge)]
        motions.append(Motion(kept.q, kept.dq, kept.ddq))
        places.append(_places(recording, robot, whole))
    return within_envelope(robot, motions, np.concatenate(places))


def _places(recording: Recording, robot: Robot, whole: Robot) -> Array:
    """Return where the tool was [N, 3] m: with all joints as recorded, or those held that the recording lacks."""
    seen = whole if set(whole.joints) <= set(recording.names) else robot
    q = recording.with_joints(seen.joints).q
    return seen.rigid.frame_position(q[:: max(1, len(q) // _POINTS)], robot.end_effector)

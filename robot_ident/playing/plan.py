"""What is played: a motion that was certified for its robot, and its rehearsals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from robot_ident.errors import InputError
from robot_ident.excitation.excitation import Excitation
from robot_ident.excitation.limits import certify
from robot_ident.excitation.playback import Playback
from robot_ident.excitation.point_to_point import load_motion
from robot_ident.excitation.reference import Reference
from robot_ident.playing.player import end_of
from robot_ident.playing.slowed import Slowed
from robot_ident.robot import Robot

_USUAL_RATE = 150.0  # Hz
_BACK = 1e-6  # rad or m: a motion that ends there has come back


@dataclass(frozen=True)
class Plan:
    """A certified motion of a robot, the motions that go before it, and the rate [Hz] that it was made for.

    unchecked: what no certificate covers, in words.
    """

    robot: Robot
    motion: Reference
    rehearsals: tuple[Slowed, ...]
    rate: float
    unchecked: tuple[str, ...]


def load_plan(
    path: str | Path, robot: Robot, *, periods: int, speed: float = 1.0, rehearsals: Sequence[float] = ()
) -> Plan:
    """Return the plan that plays `periods` periods of an excitation, or a validation motion, at a share of its speed.

    rehearsals: shares of the designed speed at which one period is played first, none slower than the one before it (0:
    none). InputError when they fall, the motion doesn't end where it begins, or a limit of the robot isn't kept.
    """
    if any(later < earlier for earlier, later in pairwise(share for share in rehearsals if share > 0.0)):
        raise InputError(
            f"rehearsal = {list(rehearsals)}: slow ones come first, each as fast as the one before it or faster:"
            f" {sorted(rehearsals)}"
        )
    loaded = load_motion(path)
    loaded.check_robot(robot)
    once = Playback(loaded, robot, 1) if isinstance(loaded, Excitation) else loaded
    margins = certify(once, robot)
    if not margins.kept:
        raise InputError(f"{path}: not certified for robot {robot.name}: {margins.violations[0]}")
    way = np.abs(end_of(once) - once.start_pose)
    if any(rehearsals) and way.max() > _BACK:
        joint = robot.joints[int(np.argmax(way))]
        raise InputError(
            f"rehearsal = {list(rehearsals)}: {path} ends {way.max():.3g} from its start at {joint}, so that it"
            " can't be played twice in a row; rehearse it by speed, in a run of its own"
        )
    motion: Reference = Playback(loaded, robot, periods) if isinstance(loaded, Excitation) else loaded
    return Plan(
        robot,
        Slowed(motion, speed) if speed < 1.0 else motion,
        tuple(Slowed(once, share) for share in rehearsals if share > 0.0),
        loaded.sample_rate if isinstance(loaded, Excitation) else _USUAL_RATE,
        tuple(margins.unknown),
    )

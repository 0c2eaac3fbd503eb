"""What the command line does where data contradict what a robot YAML declares of effort."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from robot_ident.recording.measurement import Measurement
    from robot_ident.robot import Robot


def contradictions(measurements: Sequence[Measurement], robot: Robot, *, as_declared: bool) -> list[str]:
    """Return what in the data contradicts the declaration of effort.

    Raises InputError, with the line of the robot YAML to change, unless the user goes on all the same.
    """
    from robot_ident.configuration import line_of
    from robot_ident.errors import InputError
    from robot_ident.estimation.contradiction import contradiction
    from robot_ident.estimation.declaration import judge_all

    found = contradiction(judge_all(measurements, robot), robot)
    if found is None:
        return []
    if as_declared:
        return [f"{found.in_words}; taken as declared"]
    line = line_of(robot.source, found.entry)
    place = robot.source if line is None else f"{robot.source}:{line}"
    raise InputError(f"{place}: {found.in_words}; change it to '{found.change}', or go on with --as-declared")

"""What the command line does where data contradict what a robot YAML declares of effort."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from robot_ident.recording.measurement import Measurement
    from robot_ident.robot import Robot


AS_DECLARED = "; taken as declared"
"""What a model notes of a contradiction that its user went on with."""


def contradictions(
    measurements: Sequence[Measurement],
    robot: Robot,
    *,
    as_declared: bool,
    otherwise: str = ", or go on with --as-declared",
) -> list[str]:
    """Return what in the data contradicts the declaration of effort.

    Raises InputError, with the line of the robot YAML to change, unless the user goes on all the same; of a clock that
    runs wrong no line tells, and it is only said. Where nothing contradicts it once stated payloads are left out, the
    sidecars that state them are named instead. otherwise: what else the user may do. Recordings with an unknown payload
    are not judged.
    """
    from robot_ident.configuration import line_of
    from robot_ident.errors import InputError
    from robot_ident.estimation.contradiction import contradiction
    from robot_ident.estimation.coupling import coupling_contradiction
    from robot_ident.estimation.declaration import clock_notes, judge_all
    from robot_ident.estimation.effort_checks import EffortChecks
    from robot_ident.recording.arm_alone import with_payload
    from robot_ident.recording.conditions import sidecar

    measurements = [m for m in measurements if not m.conditions.estimated]
    if not measurements:
        return []
    checks = EffortChecks(measurements, robot)
    foreign = checks.foreign() or checks.exchanged()
    if foreign and as_declared:
        return [f"{foreign}{AS_DECLARED}"]
    if foreign:
        raise InputError(f"{foreign}{otherwise}")
    found = (
        coupling_contradiction(measurements, robot)
        or checks.gravity()
        or contradiction(judge_all(measurements, robot), robot)
    )
    if found is None:
        return clock_notes(measurements, robot)
    if as_declared:
        return [f"{found.in_words}{AS_DECLARED}"]
    stated = {str(sidecar(m.source)): m.conditions.payload for m in measurements if m.conditions.payload is not None}
    if stated and contradiction(judge_all([with_payload(m, robot) for m in measurements], robot), robot) is None:
        told = ", ".join(f"{file}: payload.mass = {one.mass:g}" for file, one in stated.items())
        raise InputError(
            f"{told}: the effort contradicts this payload; mass is in kg, centre in m in the end effector's frame"
            f"{otherwise}"
        )
    line = line_of(robot.source, found.entry)
    place = robot.source if line is None else f"{robot.source}:{line}"
    raise InputError(f"{place}: {found.in_words}; change it to '{found.change}'{otherwise}")

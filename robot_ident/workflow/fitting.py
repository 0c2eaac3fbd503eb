"""What recordings are fitted to: a robot of which some joints may be held, at the speed at which a trajectory was run;
and the limits within which a robot has run already.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from robot_ident.bags import read_for
from robot_ident.errors import InputError
from robot_ident.limits.envelope import within_envelope
from robot_ident.planning.validation_motion import check_angles
from robot_ident.recording.checks import STILL, held_angles, still_part
from robot_ident.recording.measurement import Processing
from robot_ident.recording.process import process
from robot_ident.recording.recording import Recording
from robot_ident.recording.summary import mean_path, path_notes, speed_scale
from robot_ident.robot import Robot
from robot_ident.robot.locked_joints import hold, moving_joints
from robot_ident.signals.motion import Array, Motion
from robot_ident.trajectories.excitation import Excitation

_ALIKE = 1e-4  # difference of speeds that are the same
_BANDWIDTH = 10.0  # Hz of the derivatives of what does not repeat: beyond, noise would widen the envelope
_POINTS = 4000  # of a recording at which the tool is looked at


def at_its_speed(
    trajectories: Sequence[str], recordings: Sequence[Recording], processing: Processing
) -> tuple[list[Recording], Processing]:
    """Return recordings and processing with the time that a speed override stretched: where the path is that of
    a trajectory but slower, its period is what the data say, and a note says so.
    """
    if not trajectories:
        return list(recordings), processing
    if len(trajectories) not in (1, len(recordings)):
        raise InputError(
            f"--trajectory is given {len(trajectories)} times for {len(recordings)} recordings; give it once, or"
            " once per recording in their order"
        )
    files = [*trajectories] * (len(recordings) // len(trajectories))
    excitations = excitations_of(files)
    moving = [one.with_joints(played.joints) for one, played in zip(recordings, excitations, strict=True)]
    means = [mean_path(one) for one in moving]
    scales = [
        speed_scale(one.source, mean, _path(played), played.base_frequency)
        for one, played, mean in zip(moving, excitations, means, strict=True)
    ]
    recordings = [
        replace(one, notes=(*one.notes, *path_notes(played.joints, q, _path(played), played.base_frequency, file)))
        for one, file, played, (_, q) in zip(recordings, files, excitations, means, strict=True)
    ]
    if all(scale is None or scale == 1.0 for scale in scales):
        return recordings, processing
    slowed = [
        one
        if scale is None or scale == 1.0
        else replace(
            one,
            notes=(
                *one.notes,
                f"run at {100 * scale:.4g} % of the speed of {file}: a speed override stretched time; its"
                f" base frequency is taken as {scale * played.base_frequency:.6g} Hz",
            ),
        )
        for one, scale, file, played in zip(recordings, scales, files, excitations, strict=True)
    ]
    found = [scale for scale in scales if scale is not None]
    alike = len(found) == len(scales) and max(found) - min(found) < _ALIKE
    frequency = found[0] * excitations[0].base_frequency if alike else None
    return slowed, replace(processing, base_frequency=frequency, periodic=True)


def _path(played: Excitation) -> Callable[[Array], Array]:
    """Return the positions of an excitation as a function of time."""
    return lambda t: played.series.motion(t).q


def excitations_of(files: Sequence[str], robot: Robot | None = None) -> list[Excitation]:
    """Return the excitations of some files; InputError where one is not of the robot."""
    found = [Excitation.read(file) for file in files]
    for one in found:
        if robot is not None:
            one.check_robot(robot)
    return found


def held_for_design(robot: Robot, joints: str | None, given: Mapping[str, float]) -> tuple[Robot, dict[str, float]]:
    """Return the robot of some joints and the angles of the others: as given, else 0, or the middle of their range
    where 0 lies outside.
    """
    if joints is None:
        return robot, {}
    moving = moving_joints(robot, joints)
    angles = {}
    for joint, name in enumerate(robot.joints):
        if name not in moving:
            lower, upper = float(robot.limits.lower[joint]), float(robot.limits.upper[joint])
            angles[name] = given.get(name, 0.0 if lower < 0.0 < upper else 0.5 * (lower + upper))
    check_angles(robot, angles)
    return hold(robot, moving, angles), angles


def held_in_recordings(
    robot: Robot, recordings: Sequence[Recording], joints: str | None, given: Mapping[str, float]
) -> tuple[Robot, list[Recording], dict[str, float]]:
    """Return the robot of some joints, the parts of recordings in which the others stand still, and where they stand.

    Raises InputError where they stand elsewhere from one recording to the next: the base parameters depend on it.
    """
    if joints is None:
        return robot, list(recordings), {}
    moving = moving_joints(robot, joints)
    held = [name for name in robot.joints if name not in moving]
    found = [held_angles(recording, held, given) for recording in recordings]
    for recording, other in zip(recordings[1:], found[1:], strict=True):
        for name in held:
            if abs(other[name] - found[0][name]) > 2.0 * STILL:
                raise InputError(
                    f"{recording.source}: {name} stands at {other[name]:.4g}, in {recordings[0].source} at"
                    f" {found[0][name]:.4g}; the parameters depend on the pose: identify them apart"
                )
    angles = {name: sum(one[name] for one in found) / len(found) for name in held}
    return hold(robot, moving, angles), [still_part(recording, angles) for recording in recordings], angles


def held_note(robot: Robot, angles: dict[str, float]) -> list[str]:
    """Return a line that says which joints are held, and where."""
    if not angles:
        return []
    units = {name: "m" if slides else "rad" for name, slides in zip(robot.joints, robot.prismatic, strict=True)}
    words = ", ".join(f"{name} at {angle:.4g} {units[name]}" for name, angle in angles.items())
    return [f"held: {words}; parameters hold for this pose, links are numbered along the joints that move"]


def within_runs(bags: Sequence[str], robot: Robot, whole: Robot) -> Robot:
    """Return the robot with the envelope of recordings as its limits; itself where there are none.

    whole: the robot with all its joints, of which `robot` may hold some: its tool has been where all of them took it.
    """
    if not bags:
        return robot
    motions, places = [], []
    for bag in bags:
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

"""From a recording to a measurement: checked, put on its clock, periods averaged or low-passed."""

from __future__ import annotations

from dataclasses import replace

from robot_ident.errors import InputError
from robot_ident.recording.chain import in_newton_metres
from robot_ident.recording.clock import Clock, even_positions, read_clock, roughness
from robot_ident.recording.continuous import low_passed
from robot_ident.recording.measurement import Measurement, Processing
from robot_ident.recording.period import find_period, refine_period, steady_part
from robot_ident.recording.periodic import averaged
from robot_ident.recording.plausibility import check_plausible
from robot_ident.recording.recording import Recording
from robot_ident.recording.repeats import disturbed
from robot_ident.robot.robot import Robot


def process(recording: Recording, robot: Robot, processing: Processing | None = None) -> Measurement:
    """Return what a recording says of a robot: even time, derivatives, averaged torque and its noise.

    Raises InputError on a missing joint, wrong units, a recording too short, or one that isn't periodic where it has
    to be.
    """
    processing = processing or Processing()
    recording = recording.with_joints(robot.joints)
    recording = in_newton_metres(recording, robot)
    check_plausible(recording, robot)
    clock = read_clock(recording)
    if processing.low_pass is not None and not 0 < processing.low_pass < 0.5 / clock.dt:
        raise InputError(
            f"{recording.source}: low pass of {processing.low_pass:g} Hz;"
            f" it must lie below half the sample rate, {0.5 / clock.dt:g} Hz"
        )
    period, note = _period(recording, clock, processing)
    made = None if period is None else averaged(recording, clock, period, robot, processing)
    if made is not None and processing.base_frequency is None and processing.periodic is None:
        joints = disturbed(made, roughness(even_positions(recording, clock)))
        if joints:
            names = ", ".join(robot.joints[joint] for joint in joints)
            note = f"the motion repeats every {1 / (made.base_frequency or 1):.4g} s, but not the torque of {names}"
            made = None
    if made is None:
        made = low_passed(recording, clock, robot, processing)
    return replace(made, notes=(*recording.notes, *clock.notes, *([note] if note else []), *made.notes))


def _period(recording: Recording, clock: Clock, processing: Processing) -> tuple[float | None, str]:
    """Return the period in samples, None where the recording is to be taken as non-periodic, and why it is."""
    if processing.periodic is False:
        return None, ""
    q = even_positions(recording, clock)
    if processing.base_frequency is None:
        period = find_period(q, clock.dt)
        if period is None and processing.periodic:
            raise InputError(
                f"{recording.source}: no period found; give --base-frequency, or record at least 2 periods"
            )
        if period is not None and processing.periodic is None:
            try:
                steady_part(q, period, roughness(q), recording.source)
            except InputError:
                return None, f"the motion repeats every {period * clock.dt:.4g} s, but for less than 2 periods"
        return period, ""
    given = 1.0 / (processing.base_frequency * clock.dt)
    if len(q) < 2 * given - 2:
        raise InputError(
            f"{recording.source}: {len(q) / given:.1f} periods of {1 / processing.base_frequency:g} s;"
            " at least 2 are needed where periods are averaged"
        )
    refined = refine_period(q, given, clock.dt)
    found = find_period(q, clock.dt)
    if found is not None and abs(found - given) > 0.01 * given and abs(given / found - round(given / found)) > 0.01:
        raise InputError(
            f"{recording.source}: the motion repeats every {found * clock.dt:.4g} s,"
            f" not every {1 / processing.base_frequency:.4g} s;"
            " is this another trajectory, or does speed scaling stretch time?"
        )
    return (refined if abs(refined - given) < 0.005 * given else given), ""

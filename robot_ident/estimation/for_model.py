"""A recording as an identified model takes it: processed alike, and of what its hand carried, what the model knows."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from robot_ident.estimation.at_pose import at_pose
from robot_ident.estimation.payload import bare, identify_payload
from robot_ident.model.model import Model
from robot_ident.recording.clock import read_clock
from robot_ident.recording.conditions import KnownPayload
from robot_ident.recording.measurement import Measurement, Processing
from robot_ident.recording.process import process
from robot_ident.recording.recording import Recording


def measured_for(model: Model, recording: Recording) -> Measurement:
    """Return a recording processed as a model's own were, less the torque of its payload.

    Raises InputError where it can't be used, or its payload is unknown and can't be told from it.
    """
    return process(with_payload_found(model, recording), model.robot, processing_of(model))


def processing_of(model: Model) -> Processing:
    """Return how a model's recordings were processed."""
    return Processing(**dict(model.processing)) if model.processing else Processing()


def within_rate(low_pass: float, recording: Recording) -> float:
    """Return a low pass [Hz] that a recording can take: four fifths of half of its sample rate at most."""
    return min(low_pass, 0.4 / read_clock(recording).dt)


def with_payload_found(model: Model, recording: Recording) -> Recording:
    """Return a recording whose payload, where its conditions leave it open, is the one that the model's recordings
    told under the same name; else what this recording alone tells of it on the model's arm. Where the model holds
    joints, the part in which they stand there.
    """
    recording = at_pose(model, recording)
    conditions = recording.conditions
    if not conditions.estimated or conditions.payload is not None:
        return recording
    known, notes = payload_in(model, recording), recording.notes
    if known is None:
        bared = replace(recording, conditions=bare(conditions))
        measured = process(bared, model.robot, processing_of(model))
        found = identify_payload([measured], model, part=conditions.part)
        known = found.body.known
        notes = (*notes, f"payload found by this recording on the model's arm: {found.body.in_words}", *found.notes)
    return replace(recording, conditions=replace(conditions, payload=known), notes=notes)


def payload_in(model: Model, recording: Recording) -> KnownPayload | None:
    """Return an unknown payload as the model has it, None where it does not: one without a name is known by its
    recordings alone.
    """
    named = recording.conditions.body
    for one in model.payloads:
        files = [Path(source).name for source in one["recordings"]]
        if one["name"] == named and (named or Path(recording.source).name in files):
            xx, xy, yy, xz, yz, zz = one["inertia"]
            x, y, z = one["centre"]
            return KnownPayload(one["mass"], (x, y, z), (xx, xy, yy, xz, yz, zz))
    return None

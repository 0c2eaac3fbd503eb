"""Recordings for a model of some joints: the others have to stand where it holds them."""

from __future__ import annotations

from collections.abc import Mapping

from robot_ident.errors import InputError
from robot_ident.model.model import Model
from robot_ident.recording.checks import STILL, held_angles, still_part
from robot_ident.recording.recording import Recording


def held_by(model: Model) -> Mapping[str, float]:
    """Return the joints that a model was identified with held, and where [rad, m]; its parameters hold there alone."""
    held: Mapping[str, float] = model.provenance.get("options", {}).get("held") or {}
    return held


def at_pose(model: Model, recording: Recording) -> Recording:
    """Return the part of a recording in which the joints that a model holds stand; all of it where they aren't in it.

    Raises InputError where they move, or stand elsewhere: the model says nothing of the arm there.
    """
    angles = held_angles(recording, [name for name in held_by(model) if name in recording.names], {})
    part = still_part(recording, angles, "take a model in which it moves")
    refuse_elsewhere(model, recording.source, angles)
    return part


def refuse_elsewhere(model: Model, source: str, angles: Mapping[str, float]) -> None:
    """Raise InputError where a joint that a model holds stands at another angle [rad, m]."""
    held = held_by(model)
    for name, angle in angles.items():
        if abs(angle - held.get(name, angle)) > 2.0 * STILL:
            raise InputError(
                f"{source}: {name} stands at {angle:.4g}, the model holds it at {held[name]:.4g};"
                " its parameters depend on the pose"
            )

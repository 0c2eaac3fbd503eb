"""Reads a recording as a robot declares it: positions from the joint states, effort from where its driver puts it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from robot_ident.bags.efforts_elsewhere import with_efforts
from robot_ident.bags.forms import TABLES, form_of, open_storage
from robot_ident.bags.joint_state_decoder import JointStateDecoder
from robot_ident.bags.read import read_recording
from robot_ident.bags.tables import refuse_unnamed
from robot_ident.bags.topics import named_topic
from robot_ident.recording.checks import refuse_payload
from robot_ident.recording.conditions import read_conditions
from robot_ident.recording.recording import Recording
from robot_ident.robot import Robot
from robot_ident.robot.effort import EffortSource


def read_for(path: Path | str, robot: Robot, *, topic: str | None = None) -> Recording:
    """Return a recording whose effort is what the robot's YAML says it is: `effort.topic` and `effort.field`.

    Velocities that messages of a bag report are left out: those of a model come from the positions.

    topic: of the joint states that hold the positions; None takes what the YAML or the bag says. Effort that comes by
    other messages is interpolated at the positions' stamps, linearly; samples without any beside them are left out.
    InputError in one line as of `read_recording`, and where a topic or field holds no effort of a joint.
    """
    path = Path(path)
    refuse_payload(read_conditions(path), robot, path)
    states = topic or robot.effort.topic
    if form_of(path) in TABLES:
        refuse_unnamed(path, robot.n)
        return read_recording(path, topic=states)
    sources = dict(robot.effort.sources)
    if topic is None and states is not None and not _has_positions(path, states):
        sources = {name: sources.get(name, EffortSource(states)) for name in robot.joints}
        states = None
    if not sources:
        return read_recording(path, topic=states, velocities=False)
    recording = with_efforts(open_storage(path), str(path), states, sources, robot.joints)
    return replace(recording, conditions=read_conditions(path))


def _has_positions(path: Path, topic: str) -> bool:
    """Return whether the first messages of a topic of joint states hold positions."""
    storage = open_storage(path)
    for batch in storage.batches([named_topic(storage, path, topic)]):
        return any(piece.position.shape[1] for piece in JointStateDecoder().decode(batch))
    return True

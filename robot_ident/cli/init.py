"""`robot_ident init`."""

from __future__ import annotations

import argparse
import os
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from robot_ident.bags import read_recording, read_robot_description, topic_of_joints
from robot_ident.cli.output import print_json, say, say_written, tell
from robot_ident.cli.values import angles_of, numbers_of
from robot_ident.errors import InputError, did_you_mean
from robot_ident.estimation.effort_checks import EffortChecks
from robot_ident.files import read_text, refuse_existing, write_text
from robot_ident.limits.certifier import Certifier, beyond_check
from robot_ident.recording.measurement import Processing
from robot_ident.recording.process import process
from robot_ident.recording.resolution import position_step
from robot_ident.recording.summary import summarise
from robot_ident.robot import load_robot
from robot_ident.robot.draft import Draft, Evidence, draft_robot, height_of, weightless
from robot_ident.robot.robot import Robot
from robot_ident.robot.urdf import Inventory, read_inventory


def run(args: argparse.Namespace) -> None:
    """Write a robot YAML with what was found, guessed and is missing."""
    output = Path(args.output)
    text, source = _urdf(args)
    topic = _topic(args, [joint.name for joint in read_inventory(text, source).joints if joint.moves])
    evidence = _evidence(args.bag, topic) if args.bag else None
    inventory = read_inventory(text, source, evidence.joints if evidence else ())
    name = args.name or inventory.robot or output.stem
    urdf = Path(args.urdf) if args.urdf else output.with_name(f"{output.stem}.urdf")
    if not args.urdf:
        refuse_existing(urdf, force=args.force)
    held = _held(args.hold, inventory)
    moving = [j.name for j in inventory.chain if j.name not in held and (not evidence or j.name in evidence.joints)]
    if not moving:
        raise InputError(f"{args.bag or source}: none of {', '.join(j.name for j in inventory.chain)} is left to move")
    drafted = partial(
        draft_robot,
        inventory,
        os.path.relpath(urdf, output.parent or "."),
        name=name,
        mount=args.mount,
        gravity=_numbers(args.gravity, "--gravity", (3,)) if args.gravity else None,
        acceleration=_by_joint(args.acceleration, moving),
        held=held,
        evidence=evidence,
        topic=topic,
    )
    draft = drafted(height=height_of(drafted().text, text, str(output)))
    if not args.urdf:
        write_text(urdf, text, force=args.force)
    write_text(output, draft.text, force=args.force)
    robot = _check(output)
    if robot is not None:
        draft = replace(draft, missing=(*draft.missing, *weightless(robot)))
    unchecked = _unchecked(robot)
    if robot is not None and args.bag:
        _test_effort(output, args.bag, topic)
    if args.json:
        data = {"schema": "robot_ident/init/1", "path": str(output), "name": name}
        told = draft.to_dict()
        data |= {key: told.pop(key) for key in ("moving", "held")}
        data |= {"fixed": list(inventory.of_kind("fixed")), "mimic": dict(inventory.mimics)}
        print_json({**data, **told, "not_checked": unchecked})
        return
    _print(draft, inventory, unchecked, output)


def _urdf(args: argparse.Namespace) -> tuple[str, str]:
    """Return the URDF and where it is from."""
    if args.urdf:
        return read_text(args.urdf), args.urdf
    if not args.bag:
        raise InputError("--urdf or --bag is needed: a URDF, or a recording with /robot_description in it")
    return read_robot_description(args.bag), args.bag


def _topic(args: argparse.Namespace, joints: list[str]) -> str | None:
    """Return the topic of the robot's states, where it was asked for or there are several; None where a bag says."""
    if not args.bag:
        return None
    topic, line = topic_of_joints(args.bag, joints, args.topic)
    if line:
        tell(line)
    return topic


def _evidence(bag: str, topic: str | None) -> Evidence:
    """Return what a recording says of the robot's joints."""
    recording = read_recording(bag, topic=topic)
    summary = summarise(recording)
    unknown = np.full(len(recording.names), np.nan)
    torque, position = summary.torque_variance, summary.position_variance
    return Evidence(
        source=os.path.basename(bag.rstrip("/")),
        joints=recording.names,
        position=recording.q.mean(axis=0),
        torque_variance=unknown if torque is None else torque,
        position_variance=unknown if position is None else position,
        encoder_step=position_step(recording.q),
    )


def _held(words: list[str], inventory: Inventory) -> dict[str, float]:
    known = [joint.name for joint in inventory.joints if joint.moves]
    out = angles_of(words)
    for name in out:
        if name not in known:
            raise InputError(f"--hold {name}: no joint {name!r} moves in the URDF{did_you_mean(name, known)}")
    return out


def _numbers(text: str, option: str, lengths: tuple[int, ...]) -> list[float]:
    expected = f"{option} {text}: {' or '.join(map(str, lengths))} finite numbers were expected, separated by commas"
    return numbers_of(text, expected, lengths)


def _by_joint(text: str | None, moving: list[str]) -> dict[str, float]:
    if text is None:
        return {}
    values = _numbers(text, "--acceleration", (1, len(moving)))
    if any(value <= 0 for value in values):
        raise InputError(f"--acceleration {text}: limits must be above 0")
    return dict(zip(moving, values * len(moving) if len(values) == 1 else values, strict=True))


def _check(output: Path) -> Robot | None:
    """Load what was written, so that what is still wrong with the robot is told now; return it if it can be used."""
    try:
        return load_robot(output)
    except InputError as error:
        tell(f"written, but it can't be used yet: {error}")
        return None


def _unchecked(robot: Robot | None) -> list[str]:
    """Return what no motion of a robot is certified for: what `design` and `check` say, and what they never see."""
    if robot is None:
        return ["anything: the file can't be used yet"]
    return [*Certifier(robot).unknown, *beyond_check(robot)]


def _test_effort(output: Path, bag: str, topic: str | None) -> None:
    """Say where the recording contradicts what the draft guesses of effort, and what to write instead."""
    robot = load_robot(output)
    try:
        measured = process(read_recording(bag, topic=topic), robot, Processing(periodic=False))
        found = EffortChecks([measured], robot).declaration()
    except InputError as error:
        tell(f"effort metadata not checked: {error}")
        return
    if found is not None:
        tell(found.told(robot))


def _print(draft: Draft, inventory: Inventory, unchecked: list[str], output: Path) -> None:
    say(f"moving:  {', '.join(draft.moving)}")
    for joint, why in draft.held.items():
        say(f"held:    {joint} ({why})")
    fixed = inventory.of_kind("fixed")
    if fixed:
        say(f"fixed:   {', '.join(fixed)}")
    for guess in draft.guesses:
        say(f"guessed: {guess}")
    for what in draft.missing:
        say(f"missing: {what}")
    for what in unchecked:
        say(f"not checked: {what}")
    say_written(output)

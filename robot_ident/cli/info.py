"""`robot_ident info`."""

from __future__ import annotations

import argparse

from robot_ident.bags import describe, read_for, read_recording
from robot_ident.cli.output import print_json, say, table, tell
from robot_ident.errors import InputError
from robot_ident.estimation.declaration import Declared, judge_measured
from robot_ident.estimation.effort_checks import EffortChecks, undecided_directions
from robot_ident.recording.checks import check_plausible, check_samples, silent_efforts
from robot_ident.recording.effort import at_the_joints
from robot_ident.recording.measurement import Processing
from robot_ident.recording.process import process
from robot_ident.recording.recording import Recording
from robot_ident.recording.resolution import coarse_notes, position_step
from robot_ident.recording.summary import Summary, summarise
from robot_ident.robot import Robot, load_robot


def run(args: argparse.Namespace) -> None:
    """Describe a bag: its topics, and the joint states in it."""
    bag = describe(args.bag)
    robot = load_robot(args.robot) if args.robot else None
    summary, trouble = None, None
    declared: list[Declared] = []
    coupled: list[str] = []
    try:
        if robot is None:
            summary = summarise(read_recording(args.bag, topic=args.topic, velocities=False))
        else:
            recording = read_for(args.bag, robot, topic=args.topic).with_joints(robot.joints)
            check_samples(recording)
            check_plausible(at_the_joints(recording, robot), robot)
            summary = summarise(recording)
            declared, coupled = _judged(recording, robot)
            coupled += coarse_notes(position_step(recording.q), robot.drives.encoder_step, robot.joints)
    except InputError as error:
        if robot is not None or args.topic:
            raise
        trouble = str(error)
    topics = [{"name": t.name, "type": t.type, "messages": t.messages, "joints": list(t.joints)} for t in bag.topics]
    if args.json:
        data = {"schema": "robot_ident/info/1", "path": bag.path, "form": bag.form, "truncated": bag.truncated}
        data |= {"topics": topics, "recording": summary.to_dict() if summary else None}
        data |= {"declaration": [one.to_dict() for one in declared]}
        print_json({**data, "notes": [*bag.notes, *([trouble] if trouble else []), *coupled]})
        return
    say(f"{bag.path}: {bag.form}{', truncated' if bag.truncated else ''}")
    listed = [(t.name or "-", t.type, t.messages, ", ".join(t.joints)) for t in bag.topics]
    say(table(("topic", "type", "messages", "joints"), listed))
    tell(*dict.fromkeys([*bag.notes, *(summary.notes if summary else ()), *([trouble] if trouble else [])]))
    if summary:
        say()
        _print(summary)
    if declared:
        say("\neffort vs. the rigid-body model of the URDF (ratio 1: torque in the declared unit)")
        rows = []
        for one in declared:  # share and standard deviation where they are told
            share = ("-", "-") if one.verdict == "not_told" else (f"{one.share:.3f}", f"{one.std:.3f}")
            rows.append((one.joint, *share, one.verdict, one.hint))
        say(table(("joint", "ratio", "sigma", "verdict", "look at"), rows))
    tell(*coupled)


def _judged(recording: Recording, robot: Robot) -> tuple[list[Declared], list[str]]:
    """Return by joint how effort and rigid model go together, and what else there is to say of it."""
    if silent_efforts(recording):
        return [], ["effort is not held against the URDF: some of it was never measured"]
    if recording.conditions.estimated:
        return [], ["effort is not held against the URDF: its payload is unknown; a recording without one tells"]
    measured = process(recording, robot, Processing(periodic=False))
    declared = judge_measured(measured, robot)
    checks = EffortChecks([measured], robot)
    foreign = [line for line in (checks.foreign(), checks.exchanged()) if line]
    found = None if foreign else checks.declaration()
    told = (*foreign, found and found.told(robot), undecided_directions(measured, robot))
    return declared, [line for line in told if line]


def _print(summary: Summary) -> None:
    say(f"{summary.samples} samples in {summary.duration:.3f} s at {summary.rate:.6g} Hz, {summary.missing} missing")
    if summary.period is not None:
        say(f"period {summary.period:.6g} s, {summary.periods or 'fewer than 2'} steady periods")
    elif summary.cycles is not None:
        cycles = summary.cycles
        say(f"{cycles.count} cycles of {len(cycles.samples)} moves, {cycles.length:.4g} s each without their pauses")
    else:
        say("not periodic")
    noise_tau, noise_q = summary.torque_variance, summary.position_variance
    rows = [
        (
            name,
            float(summary.lower[k]),
            float(summary.upper[k]),
            float(summary.top_speed[k]),
            float(summary.top_torque[k]),
            None if noise_tau is None else float(noise_tau[k]) ** 0.5,
            None if noise_q is None else float(noise_q[k]) ** 0.5,
            float(summary.position_step[k]) or None,
        )
        for k, name in enumerate(summary.joints)
    ]
    header = ("joint", "lowest", "highest", "top speed", "top torque")
    say(table((*header, "torque noise", "position noise", "position step"), rows))
    say("positions rad (m), speeds rad/s (m/s), torques as recorded; noise: standard deviation of one sample")

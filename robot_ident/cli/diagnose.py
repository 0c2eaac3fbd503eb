"""`robot_ident diagnose`."""

from __future__ import annotations

import argparse
from dataclasses import replace

import numpy as np

from robot_ident.cli.output import print_json, say, say_written, table, tell
from robot_ident.cli.steps import bar, print_additions
from robot_ident.diagnosis.diagnosis import Diagnosis, Finding
from robot_ident.errors import InputError
from robot_ident.estimation.validation import residual_on, unusable_on
from robot_ident.model.model_file import write_model
from robot_ident.regression.more_than_noise import chance
from robot_ident.robot.robot import Robot
from robot_ident.workflow.inputs import Inputs, read_inputs
from robot_ident.workflow.steps import Additions, Step, add_until_adequate, find_missing

_TIED_LISTED = 3  # of the candidates that one is tied with: the table stays readable, --json has them all


def run(args: argparse.Namespace) -> None:
    """Say which physical effect is missing."""
    if args.output and not args.add_until_adequate:
        raise InputError(f"-o {args.output}: a model is written only with --add-until-adequate")
    inputs = read_inputs(args.inputs, args.validation, args.topic)
    if len(inputs.models) != 1 or not inputs.measurements:
        raise InputError("diagnose takes one model and at least one recording")
    model = inputs.models[0]
    with bar("diagnose") as tell_share:
        found = find_missing(model, inputs.measurements, inputs.validation, tell_share)
    added = add_until_adequate(found, inputs, bar) if args.add_until_adequate else Additions([found])
    steps = added.steps
    if args.output:
        write_model(steps[-1].model if added.foreseen else model, args.output, force=args.force)
    troubles = _troubles(found, inputs, steps if added.foreseen else [])
    found = replace(found, notes=model.leading((*found.notes, *troubles)))
    if args.json:
        print_json(found.to_dict() | (added.to_dict() if steps else {}))
        return
    _print(found, inputs)
    if steps:
        print_additions(found, added)
    say_written(args.output)


def _troubles(found: Diagnosis, inputs: Inputs, steps: list[Step]) -> tuple[str, ...]:
    """Return on which recordings kept aside the model is worse than none, with what was added if something was."""
    if steps:
        last = steps[-1].model.trouble
        return tuple(f"with what was added: {line}" if line == last else line for line in steps[-1].troubles)
    lines = unusable_on(inputs.models[0], inputs.validation)
    after = found.missing[-1].validation_after if found.missing else None
    if not lines or after is None:
        return lines
    held = [residual_on(inputs.models[0], measured) for measured in inputs.validation]
    torque = {
        joint: sum(one[joint].mse / size**2 for one in held if joint in one and (size := one[joint].relative))
        for joint in after
    }
    worse = any(len(held) * after[joint] > torque[joint] for joint in after)
    told = "still errs by more" if worse else "errs by less"
    return (*lines, f"with what is missing added it {told} than the torque itself")


def _print(found: Diagnosis, inputs: Inputs) -> None:
    robot, first = inputs.models[0].robot, inputs.models[0].leading()
    tell(*first)
    say(found.in_words)
    for finding in found.missing:
        _print_named(finding, inputs)
    if found.unexplained is not None and found.verdict == "missing":
        say(f"\nunexplained: {found.unexplained.joint}, {found.unexplained.where}")
    floors = _floors(inputs)
    rows = [
        (joint, found.remaining_rms[joint], floors[joint], robot.torque_unit(number))
        for number, joint in enumerate(robot.joints)
    ]
    known = all(floor is not None for floor in floors.values())
    remains = "unexplained excess rms" if known else "unexplained rms, noise included"
    if found.verdict == "adequate" and not found.hidden_in_path:
        remains += " (not significant)"
    say("", table(("joint", remains, "noise rms", "unit"), rows))
    if found.missing or found.others:
        listed = [*found.missing, *found.others]
        header = ("rank", "candidate", "named", "explains", "p", "rms before", "rms after", "unit")
        listed_rows = [_row(rank, s, s in found.missing, robot) for rank, s in enumerate(listed, 1)]
        say("", table((*header, "indistinguishable from"), listed_rows))
    tell(*(f"note: {note}" for note in found.notes if note not in first))


def _print_named(finding: Finding, inputs: Inputs) -> None:
    """Say what an effect is, how large, and what adding it will do."""
    joint = finding.place
    unit = inputs.models[0].robot.torque_unit(inputs.models[0].robot.joint_index(joint))
    sure = "" if finding.probability is None else f" (probability {finding.probability:.2f})"
    say(f"\n{finding.label}: {finding.effect.meaning}{sure}")
    for p in finding.parameters:
        say(f"  {p.in_words}")
    kinds = [] if finding.effect.trends else [("on the data", finding.mse_before, finding.mse_after)]
    if finding.validation_before is not None and finding.validation_after is not None:
        kinds.append(("on the validation", finding.validation_before, finding.validation_after))
    falls = [f"{kind} {before[joint] ** 0.5:.3g} -> {after[joint] ** 0.5:.3g} {unit}" for kind, before, after in kinds]
    doing = "correcting it" if finding.effect.measuring else "adding it"
    if falls:
        say(f"  {doing}: rms at {joint} {', '.join(falls)}")
    if finding.fix:
        say(f"  to change: {finding.fix}")
    if finding.effect.also_like:
        say(f"  looks alike, but is in no catalogue: {', '.join(finding.effect.also_like)}")
    if finding.tied_with:
        common = f" (all {finding.family})" if finding.family else ""
        say(f"  these recordings cannot discriminate it from {', '.join(finding.tied_with)}{common}")
    if finding.tied_with and finding.experiment:
        say(f"  experiment: {finding.experiment}")


def _row(rank: int, s: Finding, named: bool, robot: Robot) -> tuple[object, ...]:
    joint = s.place
    share = f"{100 * s.explained:.0f} %"
    before, after = s.mse_before[joint] ** 0.5, s.mse_after[joint] ** 0.5
    ties = s.tied_with if named else ()
    more = len(ties) - _TIED_LISTED
    tied = ", ".join(ties[:_TIED_LISTED]) + (f" and {more} more" if more > 0 else "")
    unit = robot.torque_unit(robot.joint_index(joint))
    p = chance(s.p_value)
    return (rank, s.label, "missing" if named else "", share, p, before, after, unit, tied)


def _floors(inputs: Inputs) -> dict[str, float | None]:
    """Return the rms noise of the averaged data by joint, None where it is unknown."""
    variance = np.mean([measured.averaged_variance for measured in inputs.measurements], axis=0)
    joints = inputs.models[0].robot.joints
    return {joint: float(np.sqrt(v)) if np.isfinite(v) else None for joint, v in zip(joints, variance, strict=True)}

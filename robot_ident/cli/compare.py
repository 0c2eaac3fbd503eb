"""`robot_ident compare`: where models fail, and what has changed between two."""

from __future__ import annotations

import argparse
import re
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from robot_ident.bags import Series, read_for, write_series
from robot_ident.cli.options import given
from robot_ident.cli.output import print_json, say, table, tell
from robot_ident.errors import CheckFailed, InputError, did_you_mean
from robot_ident.estimation.prediction import at_pose
from robot_ident.regression.more_than_noise import chance
from robot_ident.residuals.comparison import Comparison, JointComparison, compare
from robot_ident.residuals.likely_reason import likely_reason
from robot_ident.residuals.model_change import (
    CHANCE,
    ModelChange,
    ParameterChange,
    changed,
    shared_recordings,
    torque_change,
)
from robot_ident.residuals.regions import ALONG, symbol_and_unit
from robot_ident.residuals.time_series import along
from robot_ident.robot.robot import Robot
from robot_ident.workflow.inputs import Inputs, read_inputs

_BAR = 20  # characters of a whole bar
_BARS = 8  # variables shown for a joint
_LEAST = 0.005  # of a share that is worth a bar
_SENTENCES = 4


def run(args: argparse.Namespace) -> None:
    """Show models beside measurements, and what has changed between two models."""
    if args.over is not None and args.over not in ALONG:
        raise InputError(f"--over {args.over!r}{did_you_mean(args.over, ALONG)}")
    inputs = read_inputs(args.inputs, [], args.topic)
    if not inputs.measurements:
        _without_recording(args, inputs)
    _same_joints(inputs)
    change = change_between(inputs, asked=args.fail_on_change)
    found = [compare(model, inputs.measurements) for model in inputs.models] if inputs.measurements else []
    reason = likely_reason(inputs.models[0], inputs.measurements)
    if args.mcap:
        _write_mcap(args, inputs)
    if args.json:
        changed = None if change is None else change.to_dict()
        print_json(_to_dict(inputs, found, args.mcap) | {"change": changed, "likely_reason": reason})
    else:
        tell(*_troubles(inputs))
        if reason:
            tell(f"likely reason: {reason}")
        if found:
            _print(inputs, found)
            if args.over is not None:
                _print_profiles(inputs, found[0], args.over)
        if change is not None:
            say_change(inputs, change, after=bool(found))
        if args.mcap:
            say(f"\nwritten: {args.mcap}")
    if args.fail_on_misfit:
        _check(found[0], inputs.models[0].robot)
    if args.fail_on_change:
        check_unchanged(change)


def _without_recording(args: argparse.Namespace, inputs: Inputs) -> None:
    """Raise InputError where models alone don't do."""
    told = given(args, "--mcap --fail-on-misfit")
    if told:
        raise InputError(f"{told}: needs at least one recording in addition to {', '.join(inputs.paths)}")
    if len(inputs.models) != 2:
        raise InputError(
            f"{', '.join(inputs.paths)}: no recording; compare takes at least one recording, or two models, old and"
            " new, to say what has changed"
        )


def _same_joints(inputs: Inputs) -> None:
    first = inputs.models[0].robot
    for path, model in zip(inputs.paths, inputs.models, strict=True):
        if model.robot.joints != first.joints:
            raise InputError(
                f"{path}: model of another robot: joints {', '.join(model.robot.joints)};"
                f" {inputs.paths[0]} has {', '.join(first.joints)}"
            )


def _check(found: Comparison, robot: Robot) -> None:
    """Raise CheckFailed where the model fails, InputError where no recording determines the noise."""
    if all(joint.misfit is None for joint in found.joints):
        raise InputError(
            "--fail-on-misfit: the noise cannot be estimated from these recordings; record 2 periods or more"
        )
    failing = [
        f"{joint.name} (excess rms {joint.excess:.3g} {robot.torque_unit(number)} over the noise)"
        for number, joint in enumerate(found.joints)
        if joint.fails
    ]
    if failing:
        raise CheckFailed(f"lack of fit: {', '.join(failing)}")


def _to_dict(inputs: Inputs, found: Sequence[Comparison], mcap: str | None) -> dict[str, Any]:
    judged = [[joint.to_dict() for joint in one.joints] for one in found] or [[] for _ in inputs.models]
    models = [
        {"path": path, "effects": list(model.structure.labels), "joints": joints}
        for path, model, joints in zip(inputs.paths, inputs.models, judged, strict=True)
    ]
    return {
        "schema": "robot_ident/comparison/1",
        "joints": models[0]["joints"],
        "models": models,
        "recordings": list(inputs.bags),
        "mcap": mcap,
        "notes": [*_troubles(inputs), *(found[0].notes if found else ())],
    }


def _troubles(inputs: Inputs) -> list[str]:
    """Return a line for each model that can't follow its own recordings."""
    return [
        f"{path}: {line}" for path, model in zip(inputs.paths, inputs.models, strict=True) for line in model.leading()
    ]


def _print(inputs: Inputs, found: Sequence[Comparison]) -> None:
    robot = inputs.models[0].robot
    tell(*found[0].notes)
    rows = []
    for number in range(robot.n):
        for path, one in zip(inputs.paths, found, strict=True):
            name, *figures = one.joints[number].row()
            rows.append((name, path, *figures[:3], robot.torque_unit(number), *figures[3:-1]))
    header = ("joint", "model", "residual rms", "noise rms", "excess rms", "unit", "chi2/dof", "p", "")
    keep = [k for k in range(len(header)) if k != 1 or len(found) > 1]
    say(table([header[k] for k in keep], [[row[k] for k in keep] for row in rows]))
    for path, one in zip(inputs.paths, found, strict=True):
        for number, joint in enumerate(one.joints):
            if joint.explained_by:
                _print_joint(joint, robot, number, f" ({path})" if len(found) > 1 else "")


def _print_joint(joint: JointComparison, robot: Robot, number: int, model: str) -> None:
    unit = robot.torque_unit(number)
    known = joint.noise_variance is not None
    size = f"{joint.excess:.3g} {unit}"
    say(f"\n{joint.name}{model}: {f'excess rms {size} over the noise' if known else f'residual {size}, noise unknown'}")
    for region in joint.worst[:_SENTENCES]:
        say(f"  {joint.name}, {region.in_words(robot, number)}")
    ranked = sorted(joint.explained_by.items(), key=lambda item: -item[1])[:_BARS]
    _print_bars(
        "explained by a curve over each variable (cross-validated):",
        [(name.replace("_", " "), share) for name, share in ranked],
        "no single variable",
    )
    bands = [(f"{low:g} to {high:g} Hz", share) for low, high, share in joint.by_frequency]
    if bands:
        _print_bars("by frequency:", bands, "no single band")
    if joint.odd is not None and joint.even is not None:
        odd, even = 100 * joint.odd, 100 * joint.even
        say(f"  under time reversal: {odd:.0f} % odd (friction), {even:.0f} % even (forces, inertia)")


def _print_profiles(inputs: Inputs, found: Comparison, what: str) -> None:
    """Print the first model's residual along a variable, joint by joint."""
    robot = inputs.models[0].robot
    for number, joint in enumerate(found.joints):
        for profile in (one for one in joint.profiles if one.what == what):
            symbol, unit = symbol_and_unit(what, robot, number)
            source = f" of {profile.recording}" if profile.recording else ""
            say(f"\n{joint.name}, residual [{robot.torque_unit(number)}] as a function of {symbol} [{unit}]{source}")
            rows = [(s.lower, s.upper, s.mean, s.rms, s.noise_rms) for s in profile.stretches]
            say(table(("from", "to", "mean", "rms", "noise rms"), rows))


def _print_bars(title: str, rows: Sequence[tuple[str, float]], nothing: str) -> None:
    """Print the shares that round to 1 % or more, the rest as one line."""
    shown = [(name, share) for name, share in rows if share >= _LEAST]
    say(f"  {title}" if shown else f"  {title} {nothing}")
    if not shown:
        return
    width = max(len(name) for name, _ in shown)
    for name, share in shown:
        bar = ("█" * round(_BAR * share)).ljust(_BAR, "·")
        say(f"    {name.ljust(width)}  {bar} {100 * share:3.0f} %")


def _write_mcap(args: argparse.Namespace, inputs: Inputs) -> None:
    """Write what belongs beside the recordings in a viewer, with their own stamps."""
    series: list[Series] = []
    for number, (name, measured) in enumerate(zip(inputs.bags, inputs.measurements, strict=True), 1):
        recording = at_pose(inputs.models[0], read_for(name, inputs.models[0].robot, topic=args.topic))
        prefix = f"/bag_{number}" if len(inputs.bags) > 1 else ""
        series += _series_along(prefix, along(inputs.models[0], recording, measured))
    write_series(args.mcap, series, force=args.force)


def _series_along(prefix: str, found: Any) -> Iterator[Series]:
    rows = found.rows
    start = rows.start_ns or (0 if rows.t[0] > 0 else time.time_ns())
    stamps = start + np.rint(rows.t * 1e9).astype(np.int64)
    efforts = {"measured": found.measured, "predicted": found.predicted, "residual": found.residual}
    efforts |= {f"effect/{re.sub('[^A-Za-z0-9_]', '_', name)}": share for name, share in found.shares.items()}
    for name, effort in efforts.items():
        q, dq = (rows.q, rows.dq) if name == "measured" else (None, None)
        yield Series(f"{prefix}/{name}", rows.names, stamps, q, dq, effort)


_NAMED = 4  # changed parameters that a joint's line names


@dataclass(frozen=True)
class Change:
    """What has changed, and the rms torque [Nm] by joint that it makes along the recordings, None without any."""

    found: ModelChange
    torque: Mapping[str, float] | None

    def to_dict(self) -> dict[str, Any]:
        """Return it as `compare --json` prints it."""
        return {**self.found.to_dict(), "torque_rms": None if self.torque is None else dict(self.torque)}


def change_between(inputs: Inputs, *, asked: bool) -> Change | None:
    """Return what has changed from the first model to the second.

    None where the inputs are no two models, or where both come from one recording and are to be held against another;
    asked: whether that is an error.
    """
    if len(inputs.models) != 2:
        if asked:
            raise InputError("--fail-on-change: takes two models, the old and the new one")
        return None
    old, new = inputs.models
    if inputs.measurements and not asked and shared_recordings(old, new):
        return None
    found = changed(old, new, (inputs.paths[0], inputs.paths[1]))
    return Change(found, torque_change(old, new, inputs.measurements) if inputs.measurements else None)


def say_change(inputs: Inputs, change: Change, *, after: bool) -> None:
    """Print what has changed, joint by joint, then the parameters that did."""
    found, old, new = change.found, *inputs.paths
    tell(*(f"note: {note}" for note in found.notes))
    if found.unmatched:
        tell(f"note: not compared, because {old} does not determine them: {', '.join(found.unmatched)}")
    blank = "\n" if after else ""
    count = f"{len(found.changed)} of {len(found.parameters)} parameters"
    say(f"{blank}from {old} to {new}: {count if found.anything else 'no parameter'} changed significantly")
    say(f"(false alarm rate: at most {CHANCE:.0%} of comparisons)\n".replace("%", " %"))
    header = ("joint", "parameters", "chi2/dof", "p", *(("torque changed, rms",) if change.torque else ()), "changed")
    rows = []
    for joint in found.joints:
        mine = [p for p in found.changed if p.joint == joint.joint]
        words = [_in_words(p) for p in mine[:_NAMED]] + ([f"{len(mine) - _NAMED} more"] if len(mine) > _NAMED else [])
        told = ", ".join(words) or ("yes, spread over its parameters" if joint.changed else "-")
        torque = () if change.torque is None else (_torque(inputs, change.torque, joint.joint),)
        rows.append((joint.joint or "(all)", joint.parameters, joint.statistic, chance(joint.p_value), *torque, told))
    say(table(header, rows))
    if found.changed:
        titles = ("parameter", "old", "sigma", "new", "sigma", "change", "sigma", "p", "unit")
        figures = []
        for p in found.changed:
            told = "-" if p.p_value is None else chance(p.p_value)
            figures.append((p.name, p.old, p.old_std, p.new, p.new_std, p.change, p.std, told, p.unit))
        say("", table(titles, figures))


def _torque(inputs: Inputs, torque: Mapping[str, float], joint: str | None) -> str | None:
    robot = inputs.models[0].robot
    return joint and f"{torque[joint]:.3g} {robot.torque_unit(robot.joint_index(joint))}"


def _in_words(p: ParameterChange) -> str:
    return p.name + (f" {p.change:+.3g} {p.unit}" if p.relative is None else f" {100 * p.relative:+.3g} %")


def check_unchanged(change: Change | None) -> None:
    """Raise CheckFailed where something has changed."""
    if change is not None and change.found.anything:
        names = [_in_words(p) for p in change.found.changed]
        names = names or [f"{joint.joint or 'the robot'}" for joint in change.found.joints if joint.changed]
        raise CheckFailed(f"changed: {', '.join(names)}")

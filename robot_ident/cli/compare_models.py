"""The part of `robot_ident compare` that says what has changed between two models."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from robot_ident.cli.output import say, table, tell
from robot_ident.errors import CheckFailed, InputError

if TYPE_CHECKING:
    from robot_ident.cli.loop import Inputs
    from robot_ident.diagnosis.changed import ModelChange, ParameterChange

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
    from robot_ident.diagnosis.changed import changed, shared_recordings, torque_change

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
    from robot_ident.diagnosis.changed import CHANCE
    from robot_ident.diagnosis.more_than_noise import chance

    found, old, new = change.found, *inputs.paths
    for note in found.notes:
        tell(f"note: {note}")
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
        say()
        titles = ("parameter", "old", "sigma", "new", "sigma", "change", "sigma", "p", "unit")
        say(table(titles, [_row(p) for p in found.changed]))


def _torque(inputs: Inputs, torque: Mapping[str, float], joint: str | None) -> str | None:
    if joint is None:
        return None
    robot = inputs.models[0].robot
    return f"{torque[joint]:.3g} {robot.torque_unit(robot.joint_index(joint))}"


def _in_words(p: ParameterChange) -> str:
    return p.name + (f" {p.change:+.3g} {p.unit}" if p.relative is None else f" {100 * p.relative:+.3g} %")


def _row(p: ParameterChange) -> tuple[object, ...]:
    from robot_ident.diagnosis.more_than_noise import chance

    told = "-" if p.p_value is None else chance(p.p_value)
    return (p.name, p.old, p.old_std, p.new, p.new_std, p.change, p.std, told, p.unit)


def check_unchanged(change: Change | None) -> None:
    """Raise CheckFailed where something has changed."""
    if change is not None and change.found.anything:
        names = [_in_words(p) for p in change.found.changed]
        names = names or [f"{joint.joint or 'the robot'}" for joint in change.found.joints if joint.changed]
        raise CheckFailed(f"changed: {', '.join(names)}")

"""`diagnose --add-until-adequate`: adds what is named and diagnoses the longer model, until nothing is named."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

from robot_ident.cli.extended import Step, staircase, steps_of
from robot_ident.cli.loop import Inputs, with_model
from robot_ident.cli.output import Progress, say, table, tell
from robot_ident.errors import InputError

if TYPE_CHECKING:
    from robot_ident.diagnosis.diagnosis import Diagnosis
    from robot_ident.effects import Effect

_ROUNDS = 5  # of adding; a robot lacks less than that, and each costs a diagnosis


@dataclass
class Additions:
    """The model refitted as it was and with one effect more each time, and what was said of it after every round.

    foreseen: steps of the first round. stopped: why the last round's effects were left out, empty where none was.
    """

    said: list[Diagnosis]
    steps: list[Step] = field(default_factory=list)
    foreseen: int = 0
    stopped: str = ""

    @property
    def last(self) -> Diagnosis:
        """What is said of the model with all that was added."""
        return self.said[-1]


def add_until_adequate(found: Diagnosis, inputs: Inputs, args: argparse.Namespace) -> Additions:
    """Return what adding the effects that a diagnosis names comes to, and those that the next ones name.

    Effects that a later round names are kept where they lower the error on the recordings kept aside, if there are any.
    """
    from robot_ident.diagnosis.diagnose import diagnose
    from robot_ident.diagnosis.kept_aside import misfit_aside
    from robot_ident.estimation.effort_checks import taken_as_declared

    out, declared = Additions([found]), taken_as_declared(inputs.models[0].notes)
    if not _columns(found):
        out.steps = steps_of(inputs, (), args.validation, args.topic)
    for number in range(_ROUNDS + 1):
        effects = _columns(out.last)
        if not effects:
            break
        if number == _ROUNDS:
            out.stopped = f"{_listed(effects)} named after {_ROUNDS} rounds of adding, and not added"
            break
        try:
            steps = steps_of(inputs, effects, args.validation, args.topic)
        except InputError as error:
            if not number:
                raise
            out.stopped = f"{_listed(effects)}: can't be added: {error}"
            break
        if number and not _lower(steps):
            out.stopped = f"{_listed(effects)}: left out, adding it does not lower the error on the validation"
            break
        out.steps += steps[1:] if number else steps
        out.foreseen = out.foreseen or len(steps) - 1
        model = out.steps[-1].model
        inputs = with_model(inputs, model, args.validation, args.topic)
        with Progress("diagnose again", 1.0) as bar:
            said = diagnose(inputs.measurements, model.structure, inputs.validation, bar.reach, as_declared=declared)
            out.said.append(said)
        if out.last.verdict == "adequate":
            aside = misfit_aside(model, inputs.validation)
            out.said[-1] = replace(out.last, notes=(*out.last.notes, *aside))
    return out


def to_dict(added: Additions) -> dict[str, Any]:
    """Return the staircase, and what is said of the model with all that was added, as `--json` prints them."""
    stairs = [
        {
            "added": None if number == 0 else step.model.structure.labels[-1],
            "residual_mse": {joint: fit.mse for joint, fit in step.model.residual.items()},
            "validation_mse": step.unseen,
        }
        for number, step in enumerate(added.steps)
    ]
    after = {key: value for key, value in added.last.to_dict().items() if key != "schema"}
    return {"staircase": stairs, "after_adding": {**after, "stopped": added.stopped}}


def print_additions(found: Diagnosis, added: Additions) -> None:
    """Print the falling error, what had been predicted of it beside what came, and what is said of the model now."""
    say()
    if not added.foreseen:
        say("nothing to add")
        return
    say(staircase(added.steps))
    told = added.steps[added.foreseen].unseen
    last = next((s for s in reversed(found.missing) if s.validation_after is not None), None)
    if told is not None and last is not None and last.validation_after is not None:
        rows = [(joint, last.validation_after[joint] ** 0.5, told[joint] ** 0.5) for joint in told]
        say()
        say(table(("validation", "rms predicted", "rms of the extended model"), rows))
    say()
    say(f"diagnosis of the extended model: {_again(added.last)}")
    rest = added.last.unexplained
    if rest is not None:
        robot = added.steps[-1].model.robot
        unit = robot.torque_unit(robot.joint_index(rest.joint))
        where = f", {rest.where}" if added.last.verdict == "missing" else ""  # else it is among the words
        say(f"unexplained at {rest.joint}: {added.last.remaining_rms[rest.joint]:.3g} {unit} rms{where}")
    if added.stopped:
        say(added.stopped)
    for line in added.last.notes:
        if line not in found.notes:
            tell(f"note: {line}")


def _again(found: Diagnosis) -> str:
    """Return what is said of the longer model; of a remainder, that it is beside what was added."""
    if found.verdict != "unexplained":
        return found.in_words
    where = f"; {found.unexplained.joint}: {found.unexplained.where}" if found.unexplained else ""
    return (
        "unexplained: no known effect accounts for the error that remains with the added effects (another form of one,"
        f" or several effects){where}"
    )


def _columns(found: Diagnosis) -> list[Effect]:
    return [suspect.effect for suspect in found.missing if not suspect.effect.measuring]


def _listed(effects: Sequence[Effect]) -> str:
    return ", ".join(effect.label for effect in effects)


def _lower(steps: Sequence[Step]) -> bool:
    """Return whether the last of the steps errs less than the first on what is kept aside; True where nothing is."""
    first, last = steps[0].unseen, steps[-1].unseen
    return first is None or last is None or sum(last.values()) < sum(first.values())

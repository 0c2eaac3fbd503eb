"""How commands print a model with one effect more each time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from robot_ident.cli.output import Progress, say, table, tell
from robot_ident.diagnosis.diagnosis import Diagnosis, Tell
from robot_ident.workflow.steps import Additions, Step


@contextmanager
def bar(what: str) -> Iterator[Tell]:
    """Show how far a piece of work has come."""
    with Progress(what, 1.0) as shown:
        yield shown.reach


def staircase(steps: Sequence[Step]) -> str:
    """Return the error of each joint and model, with the noise floor."""
    robot = steps[0].model.robot
    rows: list[tuple[object, ...]] = []
    aside = steps[0].unseen is not None
    for number, joint in enumerate(robot.joints):
        for place, step in enumerate(steps):
            label = "original" if place == 0 else f"+ {step.model.structure.labels[-1]}"
            fit = step.model.residual[joint]
            floor = None if fit.noise_variance is None else fit.noise_variance**0.5
            beyond = () if step.unseen is None else (step.unseen[joint] ** 0.5,)
            row = (joint if place == 0 else "", label, fit.rms, *beyond)
            rows.append((*row, floor, robot.torque_unit(number)))
    validation = ("validation rms",) if aside else ()
    return table(("joint", "model", "rms", *validation, "noise rms", "unit"), rows)


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
        say("", table(("validation", "rms predicted", "rms of the extended model"), rows))
    say("", f"diagnosis of the extended model: {_again(added.last)}")
    rest = added.last.unexplained
    if rest is not None:
        robot = added.steps[-1].model.robot
        unit = robot.torque_unit(robot.joint_index(rest.joint))
        where = f", {rest.where}" if added.last.verdict == "missing" else ""  # else it is among the words
        say(f"unexplained at {rest.joint}: {added.last.remaining_rms[rest.joint]:.3g} {unit} rms{where}")
    if added.stopped:
        say(added.stopped)
    tell(*(f"note: {line}" for line in added.last.notes if line not in found.notes))


def _again(found: Diagnosis) -> str:
    """Return what is said of the longer model; of a remainder, that it is beside what was added."""
    if found.verdict != "unexplained":
        return found.in_words
    where = f"; {found.unexplained.joint}: {found.unexplained.where}" if found.unexplained else ""
    return (
        "unexplained: no known effect accounts for the error that remains with the added effects (another form of one,"
        f" or several effects){where}"
    )

"""What add and diagnose share: a model with one effect more each time, and its error on recordings that no fit sees."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from robot_ident.cli.loop import Inputs, validated_for
from robot_ident.cli.output import table

if TYPE_CHECKING:
    from robot_ident.effects import Effect
    from robot_ident.model.model import Model
    from robot_ident.recording.measurement import Measurement


@dataclass(frozen=True)
class Step:
    """A model and, by joint, its mean square error (Nm)^2 over the recordings kept aside; None where there are none.

    troubles: a line for each of those on which it is worse than none.
    """

    model: Model
    unseen: dict[str, float] | None
    troubles: tuple[str, ...]


def steps_of(inputs: Inputs, effects: Sequence[Effect], validation: Sequence[str], topic: str | None) -> list[Step]:
    """Return the model refitted as it is, then with one effect more each time.

    validation: paths of the recordings kept aside.
    """
    from robot_ident.bags import read_for
    from robot_ident.estimation.gains_anew import extended, measured_anew
    from robot_ident.estimation.unusable import unusable_on

    model = inputs.models[0]
    fitted = extended(
        model,
        inputs.measurements,
        lambda: [read_for(bag, model.robot, topic=topic) for bag in inputs.bags],
        effects,
    )
    unseen = [validated_for(m, validation, topic) if measured_anew(m) else inputs.validation for m in fitted]
    return [Step(m, unseen_errors(m, aside), unusable_on(m, aside)) for m, aside in zip(fitted, unseen, strict=True)]


def unseen_errors(model: Model, validation: Sequence[Measurement]) -> dict[str, float] | None:
    """Return the mean square error by joint over recordings kept aside, (Nm)^2; None where there are none."""
    import numpy as np

    from robot_ident.estimation.extend import mean_square_errors

    if not validation:
        return None
    total = np.mean([mean_square_errors(model, measured) for measured in validation], axis=0)
    return {joint: float(value) for joint, value in zip(model.robot.joints, total, strict=True)}


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

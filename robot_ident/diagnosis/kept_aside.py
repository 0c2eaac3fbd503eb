"""An adequate model beside recordings that no fit has seen."""

from __future__ import annotations

from collections.abc import Sequence

from robot_ident.diagnosis.comparison import compare
from robot_ident.model.model import Model
from robot_ident.recording.measurement import Measurement


def misfit_aside(model: Model, validation: Sequence[Measurement]) -> tuple[str, ...]:
    """Return a line where a model, adequate by the recordings that it was fitted to, misfits those kept aside."""
    if not validation:
        return ()
    robot = model.robot
    worst = [
        f"{one.name} by {one.excess:.3g} {robot.torque_unit(robot.joint_index(one.name))} rms beyond the noise"
        for one in compare(model, validation).joints
        if one.fails and not one.hidden_in_path
    ]
    if not worst:
        return ()
    return (
        f"the model does not fit what was kept aside: {', '.join(worst)} (robot_ident compare shows where); something"
        " is there that the fitted recordings don't show",
    )

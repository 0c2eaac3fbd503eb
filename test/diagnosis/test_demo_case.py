"""What `robot_ident demo` hides is seen at every joint, selected by name, and the error falls to the noise."""

from __future__ import annotations

import pytest

from robot_ident.cli.demo import HIDDEN, ROBOT
from robot_ident.diagnosis.diagnose import diagnose
from robot_ident.estimation.identify import estimate
from robot_ident.model.model import Model
from robot_ident.model.structure import Structure
from robot_ident.provenance import config_file
from robot_ident.recording.measurement import Measurement
from robot_ident.recording.process import process
from robot_ident.residuals.comparison import compare
from robot_ident.robot import load_robot
from robot_ident.testbed.phenomena import plant_physics
from robot_ident.testbed.simulation import Play
from robot_ident.trajectories.excitation import Excitation
from robot_ident.workflow.inputs import Inputs
from robot_ident.workflow.steps import add_until_adequate


def ratios(model: Model, measured: list[Measurement]) -> list[float]:
    """Return residual over noise by joint."""
    joints = compare(model, measured).joints
    return [(one.residual_mse / one.noise_variance) ** 0.5 for one in joints if one.noise_variance is not None]


@pytest.mark.long
def test_every_joint_falls_from_two_to_three_times_its_noise_to_it() -> None:
    robot = load_robot(ROBOT)
    physics = plant_physics(robot, list(HIDDEN))
    motions = [Excitation.read(config_file("paper", f"{name}.yaml")) for name in ("c1_spring", "c2_spring")]
    plays = [Play.of(robot, physics, one.series) for one in motions]
    measured = [process(play.record(10, seed=10 + k), robot) for k, play in enumerate(plays)]
    model = estimate(measured, Structure.build(robot))
    first = ratios(model, measured)
    assert len(first) == 3
    assert all(2.0 <= ratio <= 3.0 for ratio in first)
    inputs = Inputs((model,), ("model.yaml",), (), tuple(measured), ())
    added = add_until_adequate(diagnose(measured, model.structure), inputs)
    last = added.steps[-1].model
    hidden = {effect.partition(":")[0] for effect in HIDDEN}
    assert set(last.structure.labels) - set(model.structure.labels) == hidden
    assert added.last.verdict in ("adequate", "not_decidable")
    assert all(ratio <= 1.15 for ratio in ratios(last, measured))
    spring = last.structure.names.index("gravity_spring@joint_2")
    assert last.linear[spring] == pytest.approx(3.2192, abs=4.0 * last.std[spring])  # kN, part of the model all the way

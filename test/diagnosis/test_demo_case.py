"""What `robot_ident demo` hides is seen at every joint, selected by name, and the error falls to the noise."""

from __future__ import annotations

from typing import Any

import pytest

from robot_ident.cli.demo import HIDDEN
from robot_ident.diagnosis.diagnose import diagnose
from robot_ident.model.model import Model
from robot_ident.recording.measurement import Measurement
from robot_ident.residuals.comparison import compare
from robot_ident.workflow.inputs import Inputs
from robot_ident.workflow.steps import add_until_adequate


def ratios(model: Model, measured: list[Measurement]) -> list[float]:
    """Return residual over noise by joint."""
    joints = compare(model, measured).joints
    return [(one.residual_mse / one.noise_variance) ** 0.5 for one in joints if one.noise_variance is not None]


@pytest.mark.parametrize("seed", [1, 2])
def test_every_joint_falls_from_two_to_three_times_its_noise_to_it(bench: Any, seed: int) -> None:
    measured = bench.measure(HIDDEN, [0, 1], noise=0.6, seed=seed)  # 6 periods: as quiet as the demo's 10
    model = bench.model(measured)
    first = ratios(model, measured)
    assert len(first) == 3
    assert all(2.0 <= ratio <= 3.0 for ratio in first)
    inputs = Inputs((model,), ("model.yaml",), (), tuple(measured), ())
    added = add_until_adequate(diagnose(measured, model.structure), inputs)
    last = added.steps[-1].model
    hidden = {effect.partition(":")[0] for effect in HIDDEN}
    assert set(last.structure.labels) - set(model.structure.labels) == hidden
    assert added.last.verdict == "adequate"
    assert all(ratio <= 1.15 for ratio in ratios(last, measured))
    offset = last.structure.names.index("torque_offset@joint_1")
    assert last.linear[offset] == pytest.approx(-12.72, abs=4.0 * last.std[offset])

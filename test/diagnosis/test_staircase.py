"""The staircase of the falling error, and the step that is foreseen."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import pytest

from robot_ident.diagnosis.staircase import foresee, staircase
from robot_ident.errors import InputError
from robot_ident.estimation.validation import validate
from robot_ident.robot import load_robot

if TYPE_CHECKING:
    from robot_ident.workflow.findings import Findings


def test_levels_are_those_of_identify_and_validate(findings: Findings) -> None:
    for step in findings.steps:
        fits = step.model.residual
        unseen = validate(step.model, findings.validation[0].recording).residual
        for joint in findings.robot.joints:
            assert step.training[joint].rms == pytest.approx(fits[joint].rms, rel=0.01)
            assert step.training[joint].noise_variance == pytest.approx(fits[joint].noise_variance, rel=1e-6)
            assert step.validation[joint].mse == pytest.approx(unseen[joint].mse)


def test_the_second_step_says_what_it_adds(findings: Findings) -> None:
    assert [step.added for step in findings.steps] == [(), ("stribeck@joint_2",)]
    assert [step.name for step in findings.steps] == ["model_1", "model_2"]


def test_what_is_foreseen_comes_true(findings: Findings) -> None:
    first, last = findings.steps
    foreseen = foresee(first, findings.diagnoses[0], findings.validation)
    assert foreseen is not None
    assert foreseen.added == ("stribeck@joint_2",)
    for joint in findings.robot.joints:
        assert foreseen.training[joint].mse == pytest.approx(last.training[joint].mse, rel=0.02)
        assert foreseen.validation[joint].mse == pytest.approx(last.validation[joint].mse, rel=0.05)
    assert foreseen.training["joint_2"].mse < 0.8 * first.training["joint_2"].mse
    assert foresee(last, findings.diagnosis, findings.validation) is None


def test_models_of_several_robots_are_refused(findings: Findings) -> None:
    model = findings.last.model
    other = replace(load_robot(), joints=("a", "b", "c"))
    stranger = replace(model, structure=replace(model.structure, robot=other))
    with pytest.raises(InputError, match="other.yaml: model of another robot: joints a, b, c"):
        staircase([("model.yaml", model), ("other.yaml", stranger)], findings.training)


def test_files_named_alike_are_told_by_their_folders(findings: Findings) -> None:
    model = findings.last.model
    steps = staircase([("a/model.yaml", model), ("b/model.yaml", model)], findings.training)
    assert [step.name for step in steps] == ["a/model.yaml", "b/model.yaml"]

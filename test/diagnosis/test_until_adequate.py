"""What is missing is added, and the longer model diagnosed again."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from robot_ident.cli.steps import print_additions
from robot_ident.diagnosis.diagnosis import Diagnosis
from robot_ident.workflow.inputs import Inputs
from robot_ident.workflow.steps import add_until_adequate

HIDDEN = ("stribeck@joint_2:stribeck=20,speed=0.08", "torque_offset@joint_3:torque_offset=5")


@pytest.fixture(scope="module")
def inputs(bench: Any) -> Inputs:
    """Recordings with two effects hidden, and the model without either."""
    measured = bench.measure(HIDDEN)
    return Inputs((bench.model(measured),), ("model.yaml",), (), tuple(measured), tuple(bench.measure(HIDDEN, [3])))


@pytest.fixture(scope="module")
def half(bench: Any) -> Diagnosis:
    """A diagnosis that has seen one of the two only."""
    found = bench.diagnose(HIDDEN)
    assert {finding.label for finding in found.missing} == {"stribeck@joint_2", "torque_offset@joint_3"}
    return replace(found, missing=tuple(s for s in found.missing if s.label == "stribeck@joint_2"))


@pytest.mark.long
def test_what_the_longer_model_lacks_is_added_too(
    half: Diagnosis, inputs: Inputs, capsys: pytest.CaptureFixture[str]
) -> None:
    added = add_until_adequate(half, inputs)
    assert [one.verdict for one in added.said] == ["missing", "missing", "adequate"]
    assert [step.model.structure.labels[-1] for step in added.steps[1:]] == [
        "stribeck@joint_2",
        "torque_offset@joint_3",
    ]
    assert added.foreseen == 1
    data = added.to_dict()
    assert [step["added"] for step in data["staircase"]] == [None, "stribeck@joint_2", "torque_offset@joint_3"]
    falling = [sum(step["validation_mse"].values()) for step in data["staircase"]]
    assert falling == sorted(falling, reverse=True)
    assert data["after_adding"]["verdict"] == "adequate"
    print_additions(half, added)
    assert "diagnosis of the extended model: adequate: what is left over is noise" in capsys.readouterr().out


@pytest.mark.long
def test_what_does_not_lower_the_error_on_the_validation_is_not_named(
    bench: Any, half: Diagnosis, inputs: Inputs
) -> None:
    """The offset is in the recordings that are fitted, not in the one kept aside."""
    other = replace(inputs, validation=tuple(bench.measure(HIDDEN[:1], [3])))
    added = add_until_adequate(half, other)
    assert [step.model.structure.labels[-1] for step in added.steps[1:]] == ["stribeck@joint_2"]
    assert added.last.missing == () and added.last.verdict != "adequate"


@pytest.mark.long
def test_an_adequate_end_that_misfits_what_was_kept_aside_says_so(
    bench: Any, inputs: Inputs, capsys: pytest.CaptureFixture[str]
) -> None:
    """All that the fitted recordings show is added; the one kept aside shows more."""
    more = (*HIDDEN, "torque_offset@joint_1:torque_offset=9")
    found = bench.diagnose(HIDDEN)
    added = add_until_adequate(found, replace(inputs, validation=tuple(bench.measure(more, [3]))))
    assert added.last.verdict == "adequate"
    assert "the model does not fit what was kept aside: joint_1 by" in added.last.notes[-1]
    print_additions(found, added)
    assert "note: the model does not fit what was kept aside: joint_1 by" in capsys.readouterr().err


def test_where_nothing_is_named_the_staircase_is_the_model_as_it_is(
    bench: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    measured = bench.measure(())
    plain = Inputs((bench.model(measured),), ("model.yaml",), (), tuple(measured), tuple(bench.measure((), [3])))
    added = add_until_adequate(bench.diagnose(()), plain)
    data = added.to_dict()
    assert [step["added"] for step in data["staircase"]] == [None]
    assert data["after_adding"]["verdict"] == "adequate"
    assert set(data["staircase"][0]["validation_mse"]) == {"joint_1", "joint_2", "joint_3"}
    print_additions(added.last, added)
    assert capsys.readouterr().out.strip() == "nothing to add"


def test_adding_ends_after_some_rounds_and_says_so(
    half: Diagnosis, inputs: Inputs, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("robot_ident.workflow.steps._ROUNDS", 1)
    added = add_until_adequate(half, inputs)
    assert [step.model.structure.labels[-1] for step in added.steps[1:]] == ["stribeck@joint_2"]
    assert added.stopped == "torque_offset@joint_3 named after 1 rounds of adding, and not added"

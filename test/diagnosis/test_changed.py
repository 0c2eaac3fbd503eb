"""What has changed between two models: found where the plant changed, and no more often than chance where it didn't."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from robot_ident.effects import make_effect
from robot_ident.errors import InputError
from robot_ident.estimation.identify import estimate, extend
from robot_ident.model.model import Model
from robot_ident.model.model_file import write_model
from robot_ident.model.structure import Structure
from robot_ident.recording import process
from robot_ident.residuals.model_change import changed, torque_change
from robot_ident.testbed.phenomena import plant_physics
from robot_ident.testbed.simulation import Play

Verb = Callable[..., tuple[int, str, str]]
SEEDS = range(10)


@pytest.fixture(scope="module")
def before(bench: Any) -> list[Model]:
    return [bench.model(bench.measure((), [0], noise=1.0, seed=seed)) for seed in SEEDS]


@pytest.fixture(scope="module")
def later(bench: Any) -> list[Model]:
    """The same robot on another motion."""
    return [bench.model(bench.measure((), [1], noise=1.0, seed=50 + seed)) for seed in SEEDS]


@pytest.fixture(scope="module")
def worn(bench: Any) -> Model:
    """Joint 1 of the same robot with 20 % more Coulomb friction."""
    truth = bench.robot.simulation
    friction = {**truth["coulomb"], "joint_1": {"coulomb": 1.2 * truth["coulomb"]["joint_1"]["coulomb"]}}
    robot = replace(bench.robot, simulation={**truth, "coulomb": friction})
    recording = Play.of(robot, plant_physics(robot, ()), bench.motions[1]).record(6, seed=77)
    return bench.model([process(recording, bench.robot)])


@pytest.mark.long
def test_noise_alone_changes_nothing_and_is_as_large_as_said(before: list[Model], later: list[Model]) -> None:
    found = [changed(old, new) for old, new in zip(before, later, strict=True)]
    assert not any(one.anything for one in found)
    z = np.array([[p.change / p.std for p in one.parameters] for one in found])
    assert z.shape == (len(SEEDS), 21)
    assert np.mean(np.abs(z) < 1.96) == pytest.approx(0.95, abs=0.05)
    statistics = np.array([[joint.statistic for joint in one.joints] for one in found])
    assert statistics.mean() == pytest.approx(1.0, abs=0.3)


def test_more_friction_is_found_where_it_is(before: list[Model], worn: Model, bench: Any) -> None:
    found = changed(before[0], worn)
    (one,) = found.changed
    assert one.name == "coulomb@joint_1"
    assert one.relative == pytest.approx(0.2, abs=0.05)
    assert [joint.joint for joint in found.joints if joint.changed] == ["joint_1"]
    torque = torque_change(before[0], worn, bench.measure((), [2], noise=1.0))
    assert torque["joint_1"] == pytest.approx(0.2 * 35.12, rel=0.2)
    assert torque["joint_1"] > 4 * max(torque["joint_2"], torque["joint_3"])


def test_base_parameters_of_another_choice_are_converted(bench: Any, before: list[Model], worn: Model) -> None:
    robot = replace(bench.robot, base_parameters={})
    structure = Structure.build(robot)
    assert structure.names[:15] != bench.structure.names[:15]
    recording = bench.record((), 1, noise=1.0, seed=50)
    other = estimate([process(recording, robot)], structure)
    same = estimate([process(recording, bench.robot)], bench.structure)
    found, plain = changed(before[0], other), changed(before[0], same)
    assert found.unmatched == ()
    assert len(found.parameters) == 21
    for mine, theirs in zip(found.joints, plain.joints, strict=True):
        assert mine.joint == theirs.joint
    total = [sum(j.statistic * j.parameters for j in one.joints) for one in (found, plain)]
    assert total[0] == pytest.approx(total[1], rel=0.5)
    friction = [{p.name: p.change for p in one.parameters if "@" in p.name} for one in (found, plain)]
    assert friction[0] == pytest.approx(friction[1], rel=1e-6, abs=1e-6)


def test_of_a_misfit_whose_sigmas_count_noise_alone_it_is_said(bench: Any, before: list[Model]) -> None:
    """As models of release 0.1.0 are; one of today counts what it lacks."""
    lacking = bench.model(bench.measure(("stribeck@joint_2:stribeck=60,speed=0.08",), [1]))
    assert lacking.noise_covariance is not None
    old = replace(lacking, covariance=lacking.by_noise, noise_covariance=None)
    said = [any("count noise alone" in note for note in changed(before[0], one).notes) for one in (lacking, old)]
    assert said == [False, True]


def test_an_effect_of_one_model_alone_is_said(bench: Any, before: list[Model]) -> None:
    (_, more) = extend(
        before[1], bench.measure((), [2], noise=1.0), [make_effect("torque_offset@joint_2", bench.robot)]
    )
    found = changed(before[0], more, ("old.yaml", "new.yaml"))
    assert found.only_new == ("torque_offset@joint_2",)
    assert found.only_old == ()
    assert "only new.yaml holds torque_offset@joint_2" in found.notes[0]
    assert {p.name for p in found.parameters} == set(before[0].structure.names)


def test_models_of_one_recording_are_refused(before: list[Model]) -> None:
    marked = replace(before[0], provenance={"recordings": [{"path": "run_1", "sha256": "ab"}]})
    with pytest.raises(InputError, match="both identified from run_1"):
        changed(marked, marked)


def test_two_models_need_no_recording(
    verb: Verb, before: list[Model], later: list[Model], worn: Model, files: Any, tmp_path: Path, checkout: Path
) -> None:
    for name, model in (("old", before[0]), ("same", later[0]), ("worn", worn)):
        write_model(model, tmp_path / f"{name}.yaml")
    old, same, new = (tmp_path / f"{name}.yaml" for name in ("old", "same", "worn"))
    code, out, err = verb("compare", old, new, "--json")
    assert code == 0, err
    data = json.loads(out)
    assert data["joints"] == data["recordings"] == []
    assert [p["name"] for p in data["change"]["parameters"] if p["changed"]] == ["coulomb@joint_1"]
    text = (checkout / "docs/json.md").read_text(encoding="utf-8")
    for name in (*data["change"], *data["change"]["parameters"][0], *data["change"]["joints"][0]):
        assert f"`{name}`" in text, name
    code, out, _ = verb("compare", old, new, files.unseen)
    assert code == 0
    assert "1 of 21 parameters changed" in out
    assert re.search(r"joint_1 .* Nm +coulomb@joint_1 \+\d+", out)
    assert verb("compare", old, same, "--fail-on-change")[0] == 0
    code, _, err = verb("compare", old, new, "--fail-on-change")
    assert (code, len(err.splitlines())) == (3, 1)
    assert "changed: coulomb@joint_1" in err


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["OLD"], "two models, old and new"),
        (["OLD", "OLD", "OLD"], "two models, old and new"),
        (["OLD", "OLD", "--fail-on-misfit"], "at least one recording"),
        (["OLD", "OLD", "--mcap", "out.mcap"], "at least one recording"),
        (["OLD", "BAG", "--fail-on-change"], "takes two models"),
    ],
)
def test_too_little_is_said_in_a_line(verb: Verb, files: Any, words: list[str], said: str) -> None:
    places = {"OLD": files.model, "BAG": files.unseen}
    code, _, err = verb("compare", *(places.get(word, word) for word in words))
    lines = [line for line in err.splitlines() if line.startswith("robot_ident ")]
    assert code == 2
    assert len(lines) == 1
    assert said in lines[0]

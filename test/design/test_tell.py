"""The motion that tells two effects apart, and the words where none does."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from robot_ident.design import discrimination
from robot_ident.design.discrimination import MENU, NEEDED, Sketch, draw, experiment_between, tell_apart, tell_command
from robot_ident.design.target import Target
from robot_ident.effects import make_effect
from robot_ident.errors import InputError
from robot_ident.limits.certifier import certify
from robot_ident.robot import Robot
from robot_ident.signals.motion import Array


@pytest.fixture
def few(monkeypatch: pytest.MonkeyPatch) -> None:
    """Try few motions."""
    monkeypatch.setattr(discrimination, "_RANDOM", 4)
    monkeypatch.setattr(discrimination, "MENU", (("slow", 1), ("small reversals", 2), ("symmetric", 2)))
    monkeypatch.setattr(discrimination, "_ROUNDS", 1)
    monkeypatch.setattr(discrimination, "_CHILDREN", 3)


@pytest.mark.usefixtures("few")
def test_noncentrality_is_the_gain_that_data_show(kuka: Robot) -> None:
    """Fit the model with the rival to noise-free data that hold the other: what is left is the noncentrality."""
    target = Target.of_robot(kuka)
    found = tell_apart(target, "end_stop@joint_2", "gravity_spring@joint_2", workers=1)
    assert certify(found.excitation, kuka).kept
    assert found.noncentrality == min(found.of_each)
    (pair,) = discrimination._pairs(target, "end_stop@joint_2", "gravity_spring@joint_2", 0.1, 150.0, None).every
    motion = found.excitation.samples()
    weight = np.sqrt(pair.duration / found.excitation.period / kuka.noise.torque_variance)[:, None]

    def weighted(columns: Array) -> Array:
        return (columns * weight).reshape(-1, columns.shape[2])

    truth = weighted(pair.effects[0].columns(motion))[:, 0] * pair.sizes[0][0]
    rival, left = pair.effects[1], []
    for setting in rival.settings(motion):
        f = np.hstack([weighted(target.structure.columns(motion)), weighted(rival.at(setting).columns(motion))])
        f = f / np.linalg.norm(f, axis=0)
        theta, *_ = np.linalg.lstsq(f, truth, rcond=1e-9)
        left.append(float(np.sum((truth - f @ theta) ** 2)))
    assert found.of_each[0] == pytest.approx(min(left), rel=1e-3)


@pytest.mark.usefixtures("few")
def test_what_no_motion_tells_is_said_with_what_would(kuka: Robot) -> None:
    noisy = replace(Target.of_robot(kuka), torque_variance=np.full(3, 1e8))
    found = tell_apart(noisy, "cable@joint_2", "gravity_spring@joint_2", workers=1)
    assert found.noncentrality < NEEDED
    assert not found.separable
    assert "slow sweep" in found.otherwise["gravity_spring@joint_2"]


@pytest.mark.usefixtures("few")
def test_effects_of_the_load_take_the_values_of_the_robots_files(kuka: Robot) -> None:
    found = tell_apart(Target.of_robot(kuka), "load_friction@joint_2", "torque_saturation@joint_2", workers=1)
    assert found.noncentrality > 0.0


@pytest.mark.parametrize("kind", ["random", *(kind for kind, _ in MENU)])
def test_every_kind_of_motion_keeps_the_joints_limits(kuka: Robot, kind: str) -> None:
    for key in range(3):
        family, table = draw(Sketch(kind, (key,), 0.1, 150.0, (1,)), kuka, np.zeros((1, 3)))
        extremes = family.series(table).extremes()
        assert np.all(extremes.q.largest <= kuka.limits.upper)
        assert np.all(extremes.dq.largest <= kuka.limits.velocity)
        assert np.all(extremes.ddq.largest <= kuka.limits.acceleration)
        assert kind != "one joint" or not np.any(table[1:, [0, 2]])
        assert kind != "symmetric" or not np.any(table[1 : 1 + family.harmonics])
        assert kind != "fast" or family.orders[0] * family.base_frequency >= 2.5
        assert kind != "slow" or family.base_frequency == pytest.approx(0.02)


@pytest.mark.parametrize(
    ("first", "second", "words"),
    [
        ("stribeck@joint_2", "stribeck@joint_2", "two different effects"),
        ("stribek@joint_2", "cable@joint_2", "did you mean 'stribeck'"),
        ("viscous@joint_2", "cable@joint_2", "viscous@joint_2 is part of every model"),
        ("temperature_drift@joint_2", "cable@joint_2", "shows in no periodic motion"),
        ("payload", "cable@joint_2", "invisible in one run"),
    ],
)
def test_pairs_that_cannot_be(kuka: Robot, first: str, second: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        tell_apart(Target.of_robot(kuka), first, second, workers=1)


def test_the_command_names_the_robot(kuka: Robot) -> None:
    stribeck, presliding = make_effect("stribeck@joint_2", kuka), make_effect("presliding@joint_2", kuka)
    command = "robot_ident design --tell stribeck@joint_2 presliding@joint_2 --robot kuka_ir361 -o tell.yaml"
    assert tell_command("stribeck@joint_2", "presliding@joint_2", kuka) == command
    drift = make_effect("temperature_drift@joint_2", kuka)
    assert experiment_between(stribeck, [drift, presliding], kuka) == command
    assert experiment_between(stribeck, [drift], kuka) == stribeck.experiment
    assert experiment_between(stribeck, [], kuka) is None


@pytest.mark.usefixtures("few")
def test_effects_on_every_joint_are_told_apart_where_that_is_hardest(kuka: Robot) -> None:
    """Gravity does not load the first joint: of a spring against it two pairs are left."""
    target = Target.of_robot(kuka)
    pairs = discrimination._pairs(target, "stribeck@*", "gravity_spring@*", 0.1, 150.0, None)
    assert [[effect.label for effect in pair.effects] for pair in pairs.every] == [
        [f"stribeck@{joint}", f"gravity_spring@{joint}"] for joint in ("joint_2", "joint_3")
    ]
    found = tell_apart(target, "stribeck@*", "gravity_spring@*", workers=1)
    each = [pair.noncentralities(found.excitation) for pair in pairs.every]
    assert found.of_each == pytest.approx(np.min(each, axis=0))
    assert found.pairs == 2
    one = discrimination._pairs(target, "stribeck@*", "stribeck@joint_2", 0.1, 150.0, None)
    assert [pair.effects[0].label for pair in one.every] == ["stribeck@joint_1", "stribeck@joint_3"]
    with pytest.raises(InputError, match="no joint is left"):
        tell_apart(target, "viscous@*", "stribeck@joint_1")

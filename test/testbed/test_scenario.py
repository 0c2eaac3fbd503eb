"""Hidden scenarios: of the wanted size, the same for the same seed, as said, and sealed."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from robot_ident.errors import InputError
from robot_ident.model.structure import Structure
from robot_ident.recording import process
from robot_ident.regression.evidence import gather
from robot_ident.robot import Robot
from robot_ident.testbed.calibrate import calibrate, pooled, standard_motions, visible
from robot_ident.testbed.phenomena import PHYSICS, make_physics, plant_physics
from robot_ident.testbed.scenario import (
    KINDS,
    NOT_HIDDEN,
    Scenario,
    draw_scenario,
    open_sealed,
    seal,
    sealed_path,
    usual_sizes,
)
from robot_ident.testbed.simulation import Play, simulate


def plays(robot: Robot, *effects: str) -> list[Play]:
    return [Play.of(robot, plant_physics(robot, effects), motion) for motion in standard_motions(robot, 2)]


def test_standard_motions_keep_limits_and_use_them(kuka: Robot) -> None:
    motion, limits = pooled(standard_motions(kuka, 3)), kuka.limits
    for part, limit in ((motion.q, limits.upper), (motion.dq, limits.velocity), (motion.ddq, limits.acceleration)):
        assert np.all(np.abs(part) <= 0.86 * limit)
    assert np.all(np.ptp(motion.q, axis=0) > 0.9)


@pytest.mark.parametrize(
    "label", ["", "presliding@joint_1:reach=0.005", "cable@joint_2", "backlash@joint_3", "time_delay@joint_1:0.01"]
)
def test_a_play_is_the_steady_state_of_a_long_run(kuka: Robot, label: str) -> None:
    """One period that starts on the path equals what a long run from there settles to."""
    motion = standard_motions(kuka, 1)[0]
    effects = [label] if label else []
    play = Play.of(kuka, plant_physics(kuka, effects), motion)
    start = motion.motion(np.zeros(1)).q[0]
    reference = SimpleNamespace(duration=motion.period, start_pose=start, reference=motion.motion)
    long = simulate(kuka, reference, steady=(20.0, 10.0, 1), effects=effects, noise=0.0)
    last = slice(3000, 4500)
    np.testing.assert_allclose(play.period.q, long.exact.q[last], atol=2e-6)
    inside = slice(5, -5)
    off = (play.period.recorded - long.recording.tau[last])[inside]
    assert np.sqrt(np.mean(off**2)) < 0.02


def test_nothing_hidden_leaves_next_to_nothing(kuka: Robot) -> None:
    assert visible(Structure.build(kuka), plays(kuka)).max() < 0.01


@pytest.mark.parametrize("label", ["torque_offset@joint_1:5", "payload", "rotor_inertia@joint_1:9"])
def test_visible_is_what_refitting_leaves(kuka: Robot, label: str) -> None:
    """An offset has no column in the model and stays; what rigid-body parameters absorb is invisible.

    A load makes drives give way more as they reverse: noise hides a little of that.
    """
    left = visible(Structure.build(kuka), plays(kuka, label))
    if label.startswith("torque_offset"):
        assert left[0] == pytest.approx(5.0, rel=0.02)
    else:
        assert left.max() < (0.1 if label == "payload" else 0.02)


@pytest.mark.parametrize(
    "label", ["stribeck@joint_3:stribeck=20,speed=0.05", "joint_elasticity@joint_1:stiffness=30000", "cable@joint_2"]
)
def test_visible_is_what_a_recording_without_torque_noise_shows(kuka: Robot, label: str) -> None:
    """The motion of a noisy recording and the rows that it makes count, the exact torque, one fit."""
    made, structure = plays(kuka, label), Structure.build(kuka)
    noisy = [process(play.record(16, seed=k), kuka) for k, play in enumerate(made)]
    exact = [replace(m, torque=play.period.recorded) for m, play in zip(noisy, made, strict=True)]
    evidence = gather(exact, structure)
    left = visible(structure, made)
    rows = [m.used for m in exact]
    rest = [t.measured.torque - structure.columns(t.motion) @ evidence.values for t in evidence.trajectories]
    square = sum(np.sum(np.where(row, r, 0.0) ** 2, axis=0) for row, r in zip(rows, rest, strict=True))
    expected = np.sqrt(square / sum(row.sum(axis=0) for row in rows))
    joint = int(np.argmax(expected))
    assert left[joint] == pytest.approx(expected[joint], rel=0.1)


@pytest.mark.parametrize(
    ("label", "target"),
    [("stribeck@joint_2", 3.0), ("presliding@joint_3", 2.0), ("viscous_nonlinear@joint_3", 1.5), ("cable@joint_1", 4)],
)
def test_calibration_hits_the_target(kuka: Robot, label: str, target: float) -> None:
    structure = Structure.build(kuka)
    made = calibrate(make_physics(label, kuka), target, lambda p: plays(kuka, p.text), structure)
    joint = kuka.joint_index(label.partition("@")[2])
    assert made.visible[joint] == pytest.approx(target, rel=0.15)
    again = visible(structure, plays(kuka, made.physics.text))
    np.testing.assert_allclose(again, made.visible, rtol=1e-3)


def test_calibration_stays_plausible(kuka: Robot) -> None:
    physics = make_physics("joint_elasticity@joint_1", kuka)
    made = calibrate(physics, 50.0, lambda p: plays(kuka, p.text), Structure.build(kuka))
    assert made.physics.values["stiffness"] == pytest.approx(physics.values["stiffness"] / physics.largest)
    assert made.visible.max() < 50.0


def test_same_seed_same_scenario(kuka: Robot) -> None:
    first, again = draw_scenario(3, kuka), draw_scenario(3, kuka)
    assert first == again
    others = {draw_scenario(seed, kuka, kinds=["single"], names=["torque_offset"]).effects for seed in range(4)}
    assert len(others) > 1


def test_a_cable_and_an_offset_are_not_hidden_in_one_joint(kuka: Robot) -> None:
    """The cable's torque holds an offset: nothing could tell whether there is another one."""
    with pytest.raises(InputError, match="no effect leaves"):
        draw_scenario(1, kuka, kinds=["same_joint"], names=["cable", "torque_offset"])


FAST = "null", "single", "same_joint"


@pytest.mark.parametrize(
    "kind", [kind if kind in FAST else pytest.param(kind, marks=pytest.mark.long) for kind in KINDS]
)
def test_kinds(kuka: Robot, kind: str) -> None:
    made = draw_scenario(11, kuka, kinds=[kind])
    names = [label.partition("@")[0] for label in made.labels]
    assert made.kind == kind
    assert len(names) == {"null": 0, "pair_other_joints": 2, "same_joint": 2, "triple": 3}.get(kind, 1)
    assert all(name.startswith("unknown_") == (kind == "unknown") for name in names)
    assert not set(names) & set(NOT_HIDDEN)
    if kind == "null":
        assert max(made.visible_rms) < 0.01
    else:
        assert 0.9 <= max(made.visible_rms) < 12.0
    if kind in ("pair_other_joints", "same_joint"):
        assert len({label.partition("@")[2] for label in made.labels}) == (1 if kind == "same_joint" else 2)
    assert len(made.background) == (3 if kind == "single_with_background" else 0)
    if made.background:
        behind = visible(Structure.build(kuka), plays(kuka, *made.background))
        main = visible(Structure.build(kuka), plays(kuka, *made.effects))
        assert 0.1 < np.sqrt(np.sum(behind**2)) / main.max() < 0.6


def hides(robot: Robot, effect: str) -> Scenario:
    return Scenario(kind="single", seed=0, robot=robot.name, effects=(effect,), background=(), visible_rms=())


def test_recordings_of_a_scenario(kuka: Robot) -> None:
    scenario = hides(kuka, "torque_offset@joint_2:torque_offset=30.0")
    motions = standard_motions(kuka, 2)
    first, second = (play.record(3, seed=4 + k) for k, play in enumerate(scenario.plays(kuka, motions)))
    again = scenario.plays(kuka, motions)[0].record(3, seed=4)
    np.testing.assert_array_equal(first.tau, again.tau)
    assert first.tau.shape == (4500, 3)
    assert np.any(first.tau[:1500] != first.tau[1500:3000])
    quiet = scenario.plays(kuka, motions)[0].record(1, noise=0.0)
    np.testing.assert_allclose((first.tau[:1500] - quiet.tau).var(axis=0), [400, 416, 160], rtol=0.15)
    assert np.any(first.q[:1500] != second.q[:1500])


def test_drift_trends_over_the_periods(kuka: Robot) -> None:
    scenario = hides(kuka, "temperature_drift@joint_2:temperature_drift=10.0,time_constant=40.0")
    motions = standard_motions(kuka, 1)
    drifting = scenario.plays(kuka, motions)[0].record(8, noise=0.0).tau[:, 1].reshape(8, -1)
    v = motions[0].motion(np.arange(1500) / 150).dq[:, 1]
    slopes = [np.polyfit(v, tau - drifting[0], 1)[0] for tau in drifting[1:]]
    assert np.all(np.diff(slopes) < 0)
    t = 10.0 * np.arange(8)
    assert slopes[-1] == pytest.approx(-10 * (np.exp(-5 / 40) - np.exp(-(t[-1] + 5) / 40)), rel=0.1)


@pytest.mark.long
def test_light_arms_have_small_effects(arm: Robot, kuka: Robot) -> None:
    assert usual_sizes(arm) == (0.1, 0.8)
    assert usual_sizes(kuka) == (1.0, 8.0)
    made = draw_scenario(2, arm, kinds=["single"], names=["stribeck", "torque_offset", "viscous_asymmetric"])
    assert 0.09 <= max(made.visible_rms) < 1.2


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"kinds": ["singel"]}, "did you mean 'single'"),
        ({"names": ["stribek"]}, "did you mean 'stribeck'"),
        ({"names": ["payload"]}, "'payload' can't be hidden"),
        ({"names": ["stribeck"], "kinds": ["unknown"]}, "no effect to choose from"),
        pytest.param({"names": ["joint_elasticity"], "kinds": ["single"]}, "leaves 1 Nm rms", marks=pytest.mark.long),
    ],
)
def test_impossible_wishes_are_refused(kuka: Robot, options: dict[str, list[str]], message: str) -> None:
    with pytest.raises(InputError, match=message):
        draw_scenario(0, kuka, references=standard_motions(kuka, 1), **options)
    with pytest.raises(InputError, match="must not be negative"):
        draw_scenario(-1, kuka)


def test_sealed_answer_is_opened_on_purpose_only(kuka: Robot, tmp_path: Path) -> None:
    scenario = draw_scenario(5, kuka, kinds=["single"])
    path = sealed_path(tmp_path / "bag")
    assert path == tmp_path / "bag.sealed"
    path.write_text(seal(scenario))
    name = scenario.labels[0].partition("@")[0]
    assert name in PHYSICS
    assert name not in path.read_text()
    assert "robot_ident trial --open" in json.loads(path.read_text())["note"]
    assert open_sealed(path) == scenario


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[]", "is no sealed file"),
        ("{", "can't be read as a sealed file"),
        ('{"schema": "robot_ident/sealed/1"}', "sealed: damaged"),
        ('{"schema": "robot_ident/sealed/1", "sealed": "abc"}', "sealed: damaged"),
    ],
)
def test_a_broken_seal_is_said(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "x.sealed"
    path.write_text(text)
    with pytest.raises(InputError, match=message):
        open_sealed(path)
    with pytest.raises(InputError, match="no such file"):
        open_sealed(tmp_path / "none.sealed")

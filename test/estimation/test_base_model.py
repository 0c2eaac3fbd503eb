"""The base model and its processing: chosen by motion left out, and never worse for it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import butter, sosfiltfilt

from robot_ident.estimation.base_model import Candidate, choose_base
from robot_ident.estimation.held_out import FAINT, Fitted, Grams, held_out
from robot_ident.estimation.identify import estimate, extend, identify
from robot_ident.estimation.prediction import predict
from robot_ident.estimation.validation import validate
from robot_ident.export.exported import Exported, torque_of
from robot_ident.model.expressions import columns_function
from robot_ident.model.model import Model
from robot_ident.model.model_file import read_model, write_model
from robot_ident.model.structure import Structure
from robot_ident.recording import Processing, Recording
from robot_ident.recording.conditions import Conditions
from robot_ident.recording.process import process
from robot_ident.robot import Robot, load_robot
from robot_ident.signals.motion import Array, Motion
from robot_ident.testbed.base_trial import run_base_case
from robot_ident.testbed.like_real import like_real
from robot_ident.testbed.phenomena import plant_physics
from robot_ident.testbed.simulation import Play
from robot_ident.testbed.trial import Case
from robot_ident.trajectories.fourier_series import FourierSeries

VISCOUS = np.array([8.0, 9.0, 6.0, 1.2, 1.1, 0.7])
COULOMB = np.array([6.0, 7.0, 5.0, 1.0, 0.9, 0.6])
NOISE = np.array([0.5, 0.5, 0.4, 0.1, 0.1, 0.07])
OFFSET = np.array([3.0, -4.0, 2.0, 0.8, -0.5, 0.4])


@pytest.fixture(scope="module")
def robot(checkout: Path) -> Robot:
    return load_robot(checkout / "test/golden/inputs/six_axis.yaml")


def motion_at(t: Array, seed: int, n: int = 6) -> Motion:
    """Return sums of five sines a joint that never repeat, with exact derivatives."""
    rng = np.random.default_rng(seed)
    q, dq, ddq = np.zeros((3, len(t), n))
    for joint in range(n):
        for _ in range(5):
            w, size, phase = 2 * np.pi * rng.uniform(0.05, 0.6), rng.uniform(0.1, 0.35), rng.uniform(0, 2 * np.pi)
            q[:, joint] += size * np.sin(w * t + phase)
            dq[:, joint] += size * w * np.cos(w * t + phase)
            ddq[:, joint] -= size * w**2 * np.sin(w * t + phase)
    return Motion(q, dq, ddq)


def recorded(
    robot: Robot,
    seed: int,
    *,
    offset: Array | float = 0.0,
    scale: Array | float = 1.0,
    encoder: float = 1e-5,
    seconds: float = 20.0,
    rate: float = 100.0,
    path: int | None = None,
) -> Recording:
    """Return one pass of an arm by recursive Newton-Euler, with friction, noise, and efforts in scales of their own."""
    rng = np.random.default_rng(1000 + seed)
    t = np.arange(0.0, seconds, 1.0 / rate)
    motion = motion_at(t, seed if path is None else path)
    links = robot.rigid.inverse_dynamics(motion)
    friction = VISCOUS * motion.dq + COULOMB * np.sign(motion.dq)
    tau = scale * links + friction + offset + NOISE * rng.standard_normal(links.shape)
    q = motion.q + encoder * rng.standard_normal(links.shape)
    return Recording(robot.joints, t, q, tau, source=f"pass {seed}")


def test_pieces_left_out_are_judged_as_a_fit_without_them_does() -> None:
    rng = np.random.default_rng(1)
    columns, piece = rng.standard_normal((400, 2, 5)), np.arange(400) // 50
    torque = columns @ rng.standard_normal(5) + np.array([0.1, 3.0]) * rng.standard_normal((400, 2))
    used = rng.random((400, 2)) > 0.1
    sums = Grams.of(columns, torque, piece, used, 8)
    (error,), _ = held_out(sums, [sums], 1.0, np.ones(5, dtype=bool), np.zeros(2, dtype=bool))
    for out in range(8):
        theta, variance = np.zeros(5), np.ones(2)
        for _ in range(40):
            weight = np.where(piece == out, FAINT, 1.0)[:, None] * used / variance
            root = np.sqrt(weight).ravel()
            theta = np.linalg.lstsq(columns.reshape(-1, 5) * root[:, None], torque.ravel() * root, rcond=None)[0]
            left = (torque - columns @ theta) ** 2 * used * np.where(piece == out, FAINT, 1.0)[:, None]
            variance = left.sum(axis=0) / (used * np.where(piece == out, FAINT, 1.0)[:, None]).sum(axis=0)
        expected = np.sum(((torque - columns @ theta) ** 2 * used)[piece == out], axis=0)
        np.testing.assert_allclose(error[out], expected, rtol=1e-6)


def test_a_joint_without_rows_weighs_nothing() -> None:
    rng = np.random.default_rng(2)
    columns, piece = rng.standard_normal((80, 2, 3)), np.arange(80) // 10
    torque = columns @ np.array([1.0, -2.0, 0.5]) + 0.01 * rng.standard_normal((80, 2))
    used = np.tile([True, False], (80, 1))
    sums = Grams.of(columns, torque, piece, used, 8)
    (error,), fitted = held_out(sums, [sums], 1.0, np.ones(3, dtype=bool), np.array([False, True]))
    np.testing.assert_allclose(fitted.theta, [1.0, -2.0, 0.5], atol=0.02)
    assert np.all(error[:, 1] == 0.0) and np.all(error[:, 0] > 0.0)


def test_a_piece_that_is_far_worse_does_not_hide_that_all_are() -> None:
    rng = np.random.default_rng(4)
    good = rng.uniform(0.5, 2.0, (8, 3))
    far = 4.0 * good
    far[2] *= 50.0
    best, worse, alike = (
        Candidate(Processing(), (), False, error, np.ones(3), np.zeros(0), Fitted(np.zeros(0), np.ones(3), np.ones(3)))
        for error in (good, far, rng.permutation(good))
    )
    assert worse.worse(best) > 3.0
    assert best.worse(worse) < 0.0
    assert abs(alike.worse(best)) < 2.0


def test_offsets_are_found_and_named(robot: Robot) -> None:
    model = identify([recorded(robot, 1, offset=OFFSET)], robot)
    found = {p.name: (v, s) for p, v, s in zip(model.parameters, model.values, model.std, strict=True)}
    for joint, true in zip(robot.joints, OFFSET, strict=True):
        value, std = found[f"torque_offset@{joint}"]
        assert abs(value - true) < 4 * std, joint
    assert model.base is not None
    assert f"torque_offset@{robot.joints[0]}" in model.base["effects"]
    assert any("offsets" in note and "pieces of the path left out" in note for note in model.notes)


@pytest.mark.parametrize("encoder", [pytest.param(1e-5, marks=pytest.mark.long), 1e-3])
def test_what_is_chosen_predicts_another_path_as_well_as_the_best_fixed_filter(robot: Robot, encoder: float) -> None:
    train, test = recorded(robot, 2, offset=OFFSET, encoder=encoder), recorded(robot, 3, offset=OFFSET, encoder=encoder)
    truth = motion_at(test.t, 3)
    exact = robot.rigid.inverse_dynamics(truth) + VISCOUS * truth.dq + COULOMB * np.sign(truth.dq) + OFFSET

    def error(model: object) -> float:
        predicted = predict(model, test)  # type: ignore[arg-type]
        along = np.column_stack([np.interp(predicted.t, test.t, x) for x in exact.T])
        rest = (predicted.torque - along)[50:-50]
        return float(np.sqrt(np.mean((rest / exact.std(axis=0)) ** 2)))

    offsets = [f"torque_offset@{joint}" for joint in robot.joints]
    declared = replace(robot, base="declared")
    fixed = [
        identify(
            [train],
            declared,
            effects=offsets,
            processing=Processing(periodic=False, low_pass=low_pass, derivative_bandwidth=wide),
        )
        for low_pass, wide in ((2.0, 4.0), (5.0, 5.0), (5.0, 10.0), (10.0, 20.0), (10.0, 40.0))
    ]
    assert error(identify([train], robot)) < 1.05 * min(map(error, fixed))


@pytest.mark.long
def test_moves_between_poses_are_predicted_better_than_by_a_fixed_filter(kuka: Robot) -> None:
    """Four periods of four poses at 125 Hz; on another path, positions have the noise of one pass."""
    ratios = [run_base_case(Case(seed), kuka).ratio for seed in (6013, 6025, 6028)]
    assert float(np.exp(np.mean(np.log(ratios)))) < 0.8


@pytest.mark.long
def test_scales_are_found_within_their_sigma_and_none_where_all_report_alike(robot: Robot) -> None:
    scale = np.array([1.0, 1.3, 0.8, 1.2, 0.9, 1.1])
    normalised = []
    for seed in range(4, 8):
        model = identify([recorded(robot, seed, scale=scale)], robot, as_declared=True)
        for p, value, std in zip(model.parameters, model.values, model.std, strict=True):
            if p.effect == "torque_scale":
                true = scale[robot.joint_index(p.joint or "")] / scale[0]
                normalised.append((value - true) / std)
        assert model.base is not None and len(normalised) == 5 * (seed - 3)
        assert any("torque scale" in note for note in model.notes)
    for seed in (4, 5):
        alike = identify([recorded(robot, seed)], robot)
        assert not any(p.effect == "torque_scale" for p in alike.parameters)
    assert 0.4 < np.sqrt(np.mean(np.square(normalised))) < 1.8  # the larger of two sigmas: by pieces, by half seconds
    assert np.mean(np.abs(normalised) < 2.0) > 0.8


@pytest.mark.long
def test_a_scales_sigma_stays_above_its_spread_over_the_path_when_an_effect_is_added(robot: Robot) -> None:
    scale = np.array([1.0, 1.3, 0.8, 1.2, 0.9, 1.1])
    recording = recorded(robot, 4, scale=scale)
    model = identify([recording], robot, as_declared=True)
    measured = [process(recording, robot, Processing(**dict(model.processing)))]
    effects = model.structure.with_further(["viscous_nonlinear@joint_1"]).effects[-1:]
    assert model.base is not None
    for refitted in extend(model, measured, effects):
        spread = dict(zip(robot.joints, model.base["scale_spread"], strict=True))
        scales = {
            p.joint: s for p, s in zip(refitted.parameters, refitted.std, strict=True) if p.effect == "torque_scale"
        }
        assert len(scales) == 5 and all(s >= 0.999 * spread[joint] for joint, s in scales.items())
        plain = estimate(measured, refitted.structure, processing=Processing(**dict(model.processing)))
        assert np.any(plain.std < 0.9 * refitted.std)


def test_a_model_with_scales_predicts_in_the_unit_that_is_reported(robot: Robot, tmp_path: Path) -> None:
    scale = np.array([1.0, 1.3, 0.8, 1.2, 0.9, 1.1])
    model = identify([recorded(robot, 4, scale=scale)], robot, as_declared=True)
    write_model(model, tmp_path / "model.yaml")
    again = read_model(tmp_path / "model.yaml")
    test = recorded(robot, 11, scale=scale)
    predicted = predict(again, test)
    rest = (predicted.torque - np.column_stack([np.interp(predicted.t, test.t, x) for x in test.tau.T]))[50:-50]
    assert np.all(rest.std(axis=0) < 2.0 * NOISE + 0.1 * COULOMB)
    motion = motion_at(np.linspace(0.0, 1.0, 5), 12)
    phi = columns_function(again.structure, values=again.linear)
    for k in range(5):
        symbolic = np.asarray(phi(motion.q[k], motion.dq[k], motion.ddq[k])) @ again.linear
        np.testing.assert_allclose(symbolic, again.predict(motion)[k], rtol=1e-9)


def test_options_and_declarations_stand(robot: Robot) -> None:
    recording = recorded(robot, 5, offset=OFFSET)
    asked = Processing(low_pass=6.0)
    choice = choose_base([recording], robot, (), asked)
    assert choice.processing.low_pass == 6.0
    assert choice.processing.derivative_bandwidth == pytest.approx(24.0)
    declared = choose_base([recording], replace(robot, base="declared"), (), asked)
    assert declared.processing == asked and not declared.effects and declared.to_dict() is None
    model = identify([recording], replace(robot, base="declared"))
    assert model.structure.names == Structure.build(robot).names and model.base is None


def test_what_the_data_cannot_tell_is_left_out(robot: Robot) -> None:
    """A joint about the vertical that moves with the others at rest: its inertia is all that a rotor's would add."""
    choice = choose_base([recorded(robot, 6, offset=OFFSET)], robot, (f"torque_offset@{robot.joints[0]}",))
    assert f"torque_offset@{robot.joints[0]}" not in choice.effects
    assert f"torque_offset@{robot.joints[1]}" in choice.effects


def test_what_an_offset_or_a_rotor_is_like_is_said(robot: Robot) -> None:
    """Joints 2 to 6 swing so little that weight is one torque; a rotor of joint 2 is like a link always."""
    motion = recorded(robot, 23)
    still = np.arange(1, 6)
    q = np.array(motion.q)
    q[:, still] = 1e-3 * q[:, still] + 0.3
    links = robot.rigid.inverse_dynamics(Motion(q, np.zeros_like(q), np.zeros_like(q)))
    dq = np.gradient(q, motion.t, axis=0)
    noise = NOISE * np.random.default_rng(2).standard_normal(q.shape)
    tau = links + VISCOUS * dq + COULOMB * np.sign(dq) + noise
    (note,) = [x for x in choose_base([replace(motion, q=q, tau=tau)], robot).notes if x.startswith("left out")]
    assert note.startswith("left out of the base model, since these data can't tell them apart: torque_offset@joint_")
    assert "torque_offset@joint_6 from gravity; rotor_inertia@joint_2 from the links' inertia" in note


def test_short_recordings_work(robot: Robot) -> None:
    model = identify([recorded(robot, 7, offset=OFFSET, seconds=4.0)], robot)
    assert model.base is not None
    assert all(fit.relative is not None and fit.relative < 0.5 for fit in model.residual.values())


@pytest.mark.long
def test_a_beginning_that_tells_nothing_is_no_obstacle(robot: Robot) -> None:
    """More samples at rest than a choice looks at."""
    moving = recorded(robot, 8, offset=OFFSET, rate=1000.0)
    rest = np.arange(200_500) / 1000.0
    still = OFFSET + NOISE * np.random.default_rng(3).standard_normal((len(rest), robot.n))
    whole = Recording(
        robot.joints,
        np.concatenate([rest, rest[-1] + 0.001 + moving.t]),
        np.concatenate([np.repeat(moving.q[:1], len(rest), axis=0), moving.q]),
        np.concatenate([still, moving.tau]),
        source="late",
    )
    choice = choose_base([whole], robot)
    assert f"torque_offset@{robot.joints[0]}" in choice.effects


def test_a_rotor_below_zero_is_said_to_be_none(robot: Robot) -> None:
    """What an inertia too much in the torque's record would take off again: the sensor sees less than the link."""
    late = recorded(robot, 9, offset=OFFSET)
    motion = motion_at(late.t, 9)
    joint = 4
    tau = late.tau.copy()
    tau[:, joint] -= 0.08 * motion.ddq[:, joint]
    model = identify([replace(late, tau=tau)], robot, as_declared=True)
    rotor = [k for k, p in enumerate(model.parameters) if p.name == f"rotor_inertia@{robot.joints[joint]}"]
    assert rotor and model.values[rotor[0]] < -2.0 * model.std[rotor[0]]
    assert any("is below zero: it predicts, but is none" in note for note in model.notes)


@pytest.mark.long
def test_a_recording_of_a_lower_rate_is_predicted_and_validated(robot: Robot) -> None:
    model = identify([recorded(robot, 2, offset=OFFSET, rate=500.0)], robot)
    model = replace(model, processing={**model.processing, "band": 60.0})
    slow = recorded(robot, 3, offset=OFFSET, rate=50.0)
    assert predict(model, slow).torque.shape == slow.tau.shape
    assert validate(model, slow).low_pass_hz == pytest.approx(20.0)


def test_what_a_format_without_scales_loses_is_told(robot: Robot) -> None:
    scale = np.array([1.0, 1.3, 0.8, 1.2, 0.9, 1.1])
    model = identify([recorded(robot, 4, scale=scale)], robot, as_declared=True)
    motion = motion_at(np.linspace(0.0, 10.0, 200), 12)
    lost = torque_of(model, Exported({}, (), ("torque_scale@joint_2",), ()), motion)["torque_scale@joint_2"]
    links = robot.rigid.inverse_dynamics(motion)[:, 1]
    assert lost[1] == pytest.approx(0.3 * float(np.sqrt(np.mean(links**2))), rel=0.1)
    assert np.all(lost[[0, 2, 3, 4, 5]] == 0.0)


@pytest.mark.long
def test_predictions_are_differentiated_as_comes_nearest_to_the_record() -> None:
    """With noisy encoders the fit takes positions up to twice the band; a prediction would amplify their noise."""
    robot = replace(load_robot(), base="prediction")
    case = like_real(robot, 3041)
    model = identify([case.train], robot, as_declared=True)
    own, near = model.processing["derivative_bandwidth"], model.processing["band_derivative"]
    assert near < own
    as_fitted = replace(model, processing={**model.processing, "band_derivative": None})
    ends = slice(round(0.5 * case.rate), -round(0.5 * case.rate))
    nearest, plain = (
        np.sqrt(np.mean((predict(one, case.test).torque - case.exact)[ends] ** 2)) for one in (model, as_fitted)
    )
    assert nearest < 0.8 * plain


@pytest.mark.parametrize("encoder", [1e-3, 1e-4])
def test_predictions_are_differentiated_as_the_noise_of_the_recording_asks(robot: Robot, encoder: float) -> None:
    model = identify([recorded(robot, 1, offset=OFFSET)], robot)
    other = recorded(robot, 3, encoder=encoder, path=7)
    motion = motion_at(other.t, 7)
    exact = robot.rigid.inverse_dynamics(motion) + VISCOUS * motion.dq + COULOMB * np.sign(motion.dq) + OFFSET

    def error(**processing: float | None) -> float:
        found = predict(replace(model, processing={**model.processing, **processing}), other)
        return float(np.sqrt(np.mean(((found.torque - exact)[50:-50] / exact.std(axis=0)) ** 2)))

    chosen = error(band_derivative=20.0)
    fixed = [error(band_derivative=None, derivative_bandwidth=wide) for wide in (0.5, 0.7, 1, 1.4, 2, 2.8, 4, 8, 20)]
    assert chosen <= 1.3 * min(fixed)
    assert chosen <= 0.7 * fixed[-1]


@pytest.mark.long
def test_averages_are_not_given_up_for_what_the_model_lacks() -> None:
    """Without them the noise is unknown, and nothing tells that friction grows with the load."""
    robot = replace(load_robot(), base="prediction")
    for seed in (1, 2):
        recordings = []
        for k in (0, 1):
            a, b = 0.2 * np.random.default_rng(100 * seed + k).normal(size=(2, 3, 5))
            series = FourierSeries(0.1, np.array([0.0, -0.1, -0.2]), a, b)
            play = Play.of(robot, plant_physics(robot, ["load_friction@joint_2:0.15"]), series)
            recordings.append(play.record(8, seed=10 * seed + k))
        choice = choose_base(recordings, robot)
        assert choice.taken is not None and choice.taken.averaged


def test_a_smoothed_torque_is_predicted_as_it_is_reported(robot: Robot) -> None:
    """A low pass at 2.5 Hz, without phase, of all torques: what the motion takes beyond is not in the record."""

    def smoothed(recording: Recording) -> Recording:
        sections = butter(2, 2.5, fs=1.0 / float(np.mean(np.diff(recording.t))), output="sos")
        return replace(recording, tau=sosfiltfilt(sections, recording.tau, axis=0))

    model = identify([smoothed(recorded(robot, 1, offset=OFFSET))], robot, as_declared=True)
    assert model.base is not None
    assert model.processing["band"] < 0.5 * model.base["band_hz"]
    other = smoothed(recorded(robot, 3, offset=OFFSET, path=7))

    def error(one: Model) -> float:
        left = (predict(one, other).torque - other.tau) / other.tau.std(axis=0)
        return float(np.sqrt(np.mean(left[100:-100] ** 2)))

    unsmoothed = replace(model, processing={**model.processing, "band": model.base["band_hz"]})
    assert error(model) < 0.85 * error(unsmoothed)


@pytest.mark.parametrize(
    ("asked", "scaled"),
    [
        (["torque_scale@joint_1"], ["joint_1", "joint_3", "joint_4", "joint_5", "joint_6"]),
        *(
            pytest.param([one], ["joint_2", "joint_3", "joint_4", "joint_5", "joint_6"], marks=pytest.mark.long)
            for one in ("torque_scale@joint_2", "torque_scale@*")
        ),
        pytest.param(["cable@joint_2", "torque_offset@joint_4"], None, marks=pytest.mark.long),
    ],
)
def test_an_effect_that_is_asked_for_is_kept(robot: Robot, asked: list[str], scaled: list[str] | None) -> None:
    """Also where prediction chooses its column too, or more of its kind beside it; one joint stays the reference."""
    scale = np.array([1.0, 1.3, 0.8, 1.2, 0.9, 1.1])
    model = identify([recorded(robot, 4, offset=OFFSET, scale=scale)], robot, effects=asked, as_declared=True)
    assert {label for label in asked if not label.endswith("@*")} <= {*model.structure.labels}
    labels = [label for label in model.structure.labels if label.startswith("torque_scale@")]
    if scaled is not None:
        assert sorted(labels) == [f"torque_scale@{joint}" for joint in scaled]
    assert model.base is not None and model.base["scale_spread"] is not None
    only = identify([recorded(robot, 5)], robot, effects=["torque_scale@joint_3"], as_declared=True)
    assert "torque_scale@joint_3" in only.structure.labels


@pytest.mark.long
def test_filters_that_cost_an_inertia_are_told_first(robot: Robot) -> None:
    """Positions differentiated to 240 Hz: their noise makes the columns of inertias larger, and inertias too small."""
    noisy = recorded(robot, 1, offset=OFFSET, encoder=1e-4, rate=500.0)
    chosen, asked = (
        identify([noisy], robot, processing=Processing(periodic=False, low_pass=low), as_declared=True)
        for low in (None, 60.0)
    )
    assert chosen.trouble is None
    assert not any("leave --low-pass" in note for note in chosen.notes)
    assert asked.trouble and asked.trouble == asked.notes[0]
    assert "leave --low-pass and --derivative-bandwidth out" in asked.trouble


def test_the_error_of_the_choice_names_the_recordings_that_it_is_of(robot: Robot) -> None:
    bare, loaded = recorded(robot, 1, offset=OFFSET), recorded(robot, 2, offset=OFFSET)
    choice = choose_base([bare, replace(loaded, conditions=Conditions(estimated=True))], robot)
    assert any(note.startswith("that error is of pass 1 alone") for note in choice.notes)
    assert not any("that error" in note for note in choose_base([bare, loaded], robot).notes)

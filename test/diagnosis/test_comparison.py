"""Where does a model fail? Said only where it does, and where the plant was made to differ."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from robot_ident.recording import Processing, process
from robot_ident.residuals.comparison import compare
from robot_ident.residuals.curves import Variable, held_out_share, mirror, since_reversal
from robot_ident.residuals.regions import ALONG, densest
from robot_ident.residuals.time_series import along, shares
from robot_ident.trajectories.fourier_series import FourierSeries

STRIBECK = ("stribeck@joint_2:stribeck=20,speed=0.08",)
BUMP = ("unknown_bump@joint_2:bump=25,position=0.1,width=0.08",)


@pytest.mark.parametrize("seed", range(3))
def test_a_right_model_fits_its_own_and_other_recordings(bench: Any, seed: int) -> None:
    model = bench.model(bench.measure((), [0, 1], noise=1.0, seed=seed))
    for motions in ([0, 1], [2], [3]):
        for joint in compare(model, bench.measure((), motions, noise=1.0, seed=seed + 50)).joints:
            assert joint.fails is False
            assert joint.worst == ()
            assert joint.residual_mse == pytest.approx(joint.noise_variance, rel=0.25)


def test_false_alarms_are_rare_on_recordings_not_seen(bench: Any) -> None:
    """The model's own uncertainty is no misfit: p-values of 12 joints and seeds are not small."""
    model = bench.model(bench.measure((), [0], noise=1.0, seed=7))
    p = [j.misfit.p_value for s in range(4) for j in compare(model, bench.measure((), [1], noise=1.0, seed=s)).joints]
    assert min(p) > 1e-3
    statistics = [
        j.misfit.statistic for s in range(4) for j in compare(model, bench.measure((), [2], noise=1.0, seed=s)).joints
    ]
    assert np.mean(statistics) == pytest.approx(1.0, abs=0.03)


def test_friction_at_low_speed_is_seen_there(bench: Any) -> None:
    measured = bench.measure(STRIBECK)
    one, two, three = compare(bench.model(measured), measured).joints
    assert two.fails
    assert not three.fails
    assert two.misfit.p_value < 1e-6
    assert max(two.explained_by, key=lambda name: two.explained_by[name]) == "velocity"
    assert two.explained_by["velocity"] > 0.5
    region = next(r for r in two.worst if r.what in ("speed", "velocity"))
    assert max(abs(region.lower), abs(region.upper)) < 0.4
    assert region.share > 0.5
    assert region.of_time < 0.35
    assert two.excess == pytest.approx(np.sqrt(two.residual_mse - two.noise_variance))
    assert sum(share for _, _, share in two.by_frequency) == pytest.approx(1.0)


def test_profiles_lie_beside_the_noise(bench: Any) -> None:
    measured = bench.measure(STRIBECK)
    joint = compare(bench.model(measured), measured).joints[1]
    by_name = {(p.what, p.recording): p.stretches for p in joint.profiles}
    assert {what for what, _ in by_name} == set(ALONG)
    assert sum(p.what == "time" for p in joint.profiles) == len(measured)
    velocity = by_name["velocity", None]
    slow = min(velocity, key=lambda s: max(abs(s.lower), abs(s.upper)))
    assert slow.rms > 2.0 * slow.noise_rms
    assert np.mean([s.rms**2 for s in velocity]) == pytest.approx(joint.residual_mse, rel=0.02)
    assert np.mean([s.noise_rms**2 for s in velocity]) == pytest.approx(joint.noise_variance, rel=0.02)
    assert sum(s.rms**2 for s in by_name["frequency", None]) == pytest.approx(joint.residual_mse, rel=0.02)
    assert sum(s.noise_rms**2 for s in by_name["frequency", None]) == pytest.approx(joint.noise_variance, rel=0.02)


def test_a_dent_is_seen_at_its_position(bench: Any) -> None:
    measured = bench.measure(BUMP)
    joint = compare(bench.model(measured), measured).joints[1]
    assert max(joint.explained_by, key=lambda name: joint.explained_by[name]).startswith("position")
    region = next(r for r in joint.worst if r.what == "position")
    assert region.lower < 0.1 < region.upper


def test_one_recording_is_judged_by_parts(bench: Any) -> None:
    measured = bench.measure(STRIBECK, [0])
    joint = compare(bench.model(measured), measured).joints[1]
    assert joint.fails
    assert joint.explained_by["velocity"] > 0.4


def test_noise_unknown_is_not_judged(bench: Any) -> None:
    model = bench.model(bench.measure(STRIBECK))
    measured = process(bench.record(STRIBECK, 3), bench.robot, Processing(periodic=False))
    found = compare(model, [measured])
    for joint in found.joints:
        assert joint.fails is None
        assert joint.to_dict()["lack_of_fit"] == {"statistic": None, "p_value": None}
        assert joint.residual_mse > 0.0
    assert "not judged" in found.notes[0]
    blind = replace(model, noise=replace(model.noise, torque_variance=(None,) * 3))
    assert compare(blind, [measured]).joints[0].noise_variance is None


def test_mirror_is_found_where_there_is_one(bench: Any) -> None:
    series = bench.motions[0]
    t = np.arange(1500) / 150.0
    assert mirror(series.motion(t).q) is None
    # velocities of sines alone make positions of cosines: even about t = 0, here played 3 s late
    even = FourierSeries(0.1, series.q0, 0.0 * series.a, series.b)
    rows = mirror(even.motion(t - 3.0).q)
    assert rows is not None
    np.testing.assert_allclose(even.motion(t - 3.0).q[rows], even.motion(t - 3.0).q, atol=1e-9)
    np.testing.assert_allclose(even.motion(t - 3.0).dq[rows], -even.motion(t - 3.0).dq, atol=1e-9)


@pytest.mark.parametrize(("effect", "part"), [("stribeck@joint_2", "odd"), ("cable@joint_2:cable=60", "even")])
def test_time_reversal_tells_friction_from_forces(bench: Any, effect: str, part: str) -> None:
    motions = [FourierSeries(0.1, s.q0, 0.0 * s.a, np.hypot(s.a, s.b) * np.sign(s.b) * 0.9) for s in bench.motions[:2]]
    mirrored = replace(bench, motions=motions)
    measured = mirrored.measure((effect,), [0, 1])
    joint = compare(mirrored.model(measured), measured).joints[1]
    assert joint.fails
    assert getattr(joint, part) > 0.8
    assert joint.odd + joint.even == pytest.approx(1.0)


def test_since_reversal_goes_round() -> None:
    v = np.array([1.0, 1, -1, -1, -1, 1])
    np.testing.assert_allclose(since_reversal(v, 0.5, periodic=True), [0.5, 1.0, 0, 0.5, 1.0, 0])
    np.testing.assert_allclose(since_reversal(v, 0.5, periodic=False), [0, 0.5, 0, 0.5, 1.0, 0])
    np.testing.assert_allclose(since_reversal(np.ones(3), 1.0, periodic=True), [0, 1, 2])


def test_a_curve_over_noise_explains_nothing() -> None:
    rng = np.random.default_rng(1)
    x, used = [rng.uniform(-1, 1, 2000) for _ in range(3)], [np.ones(2000, dtype=bool)] * 3
    noise = [rng.normal(size=2000) for _ in range(3)]
    bent = [n + 3 * np.sin(3 * v) for n, v in zip(noise, x, strict=True)]
    excess = sum(float(np.sum(b**2)) for b in bent) - 6000
    along_x = [Variable(v) for v in x]
    assert held_out_share(along_x, bent, used, excess) > 0.95
    assert held_out_share([Variable(rng.uniform(-1, 1, 2000)) for _ in x], bent, used, excess) < 0.02
    assert held_out_share(along_x[:1], bent[:1], used[:1], excess / 3) > 0.9


def test_densest_region_is_where_the_error_was_put() -> None:
    rng = np.random.default_rng(2)
    x, used = rng.uniform(0, 1, 4000), np.ones(4000, dtype=bool)
    r = rng.normal(size=4000) + 4.0 * ((x > 0.3) & (x < 0.5)) * rng.choice([-1, 1], 4000)
    region = densest("position", [x], [r**2], [used], [1.0])
    assert region is not None
    assert (region.lower, region.upper) == pytest.approx((0.3, 0.5), abs=0.03)
    assert region.share > 0.9
    assert region.of_time == pytest.approx(0.2, abs=0.05)


def test_shares_add_up_along_the_recording(bench: Any) -> None:
    recording = bench.record(STRIBECK, 0)
    measured = process(recording, bench.robot)
    model = bench.model([measured])
    total = sum(shares(model, measured).values())
    np.testing.assert_allclose(total, model.predict(measured.motion), atol=1e-9)
    found = along(model, recording, measured)
    assert set(found.shares) == {"rigid_body", "viscous", "coulomb"}
    assert found.rows.samples == 6 * 1500
    folded = found.predicted.reshape(6, 1500, 3)
    np.testing.assert_allclose(folded[0], folded[5], atol=1e-6)
    np.testing.assert_allclose(folded[0], model.predict(measured.motion), atol=1e-6)
    # every sample's own noise and the misfit, nothing else: motion and prediction are in step
    variance = np.var(found.residual, axis=0)
    np.testing.assert_allclose(variance[[0, 2]], 0.1 * bench.robot.noise.torque_variance[[0, 2]], rtol=0.1)

"""Production cycles that start when they may are found, aligned, and tell a noise floor as periods do."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from production_line import POSES, Line, Shift, production

from robot_ident.diagnosis.diagnose import diagnose
from robot_ident.errors import InputError
from robot_ident.estimation.identify import estimate
from robot_ident.recording import Measurement, Processing, Recording, process
from robot_ident.recording.clock import even_positions, read_clock
from robot_ident.recording.cycles import Cycles, find_cycles
from robot_ident.recording.summary import summarise
from robot_ident.signals.motion import Motion
from robot_ident.testbed.simulation import simulate


@pytest.fixture(scope="module")
def line(arm: Any) -> Line:
    """Forty cycles; the recording begins within the first."""
    return production(arm.robot)


@pytest.fixture(scope="module")
def cycles(line: Line) -> Cycles:
    clock = read_clock(line.recording)
    found = find_cycles(even_positions(line.recording, clock), clock.dt, float(clock.t[0]))
    assert found is not None
    return found


@pytest.fixture(scope="module")
def measured(arm: Any, line: Line) -> Measurement:
    return process(line.recording, arm.robot)


def test_all_whole_cycles_are_found(cycles: Cycles) -> None:
    assert (cycles.count, len(cycles.samples), cycles.moves - cycles.pieces) == (39, 5, 39 * 5)


def test_moves_are_aligned_to_a_small_part_of_a_sample(line: Line, cycles: Cycles) -> None:
    # a joint's true positions at the aligned instants differ by its speed times the error of alignment
    true = np.stack([np.interp(cycles.times, line.recording.t, column) for column in line.motion.q.T], axis=2)
    speed = np.abs(np.gradient(true.mean(axis=0), cycles.dt, axis=0))
    fast = speed > 0.5 * speed.max(axis=0)
    error = (true.std(axis=0) / np.maximum(speed, 1e-9))[fast]
    assert np.sqrt(np.mean(error**2)) < 0.01 * cycles.dt


def test_the_noise_floor_is_the_noise(arm: Any, measured: Measurement) -> None:
    assert measured.cycles is not None
    assert measured.periods == 39
    exact = arm.structure.columns(measured.motion) @ arm.structure.true_values()
    rest = np.where(measured.used[measured.rows], measured.passed(measured.torque - exact), np.nan)
    # stiction holds another torque at each rest, which the scatter counts as noise: the floor is high by a tenth or so
    assert np.all(np.nanmean(rest**2, axis=0) / measured.averaged_variance < 1.3)
    assert measured.low_pass is not None
    noise = measured.averaged_variance * measured.averages / measured.low_pass.independent
    np.testing.assert_allclose(noise / arm.robot.noise.torque_variance, 1.0, atol=0.25)


def test_rows_that_the_low_pass_makes_alike_are_not_kept(measured: Measurement) -> None:
    assert measured.low_pass is not None
    assert measured.decimate > 1
    assert 4.0 < 1.0 / (measured.dt * measured.decimate * measured.low_pass.cutoff) < 10.0
    kept = len(measured.passed(measured.torque)) * measured.independent
    assert kept == pytest.approx(measured.low_pass.independent * measured.motion.samples, rel=0.01), "none is lost"


@pytest.mark.parametrize("law", ["smooth", "fastest"])
def test_parameters_lie_within_their_sigma(arm: Any, law: str) -> None:
    line = production(arm.robot, seed=3, law=law, cycles=20)
    model = estimate([process(line.recording, arm.robot)], arm.structure)
    z = (model.linear - arm.structure.true_values()) / model.std
    assert 0.5 < np.sqrt(np.mean(z**2)) < 1.5
    assert model.recordings[0]["taken_as"] == "cycles"
    assert model.recordings[0]["repeats"] == 19


def test_a_right_model_is_adequate_and_a_wrong_one_is_not(arm: Any, measured: Measurement) -> None:
    assert diagnose([measured], arm.structure).verdict == "adequate"

    def ripple(motion: Motion) -> Any:
        return np.column_stack([np.zeros(motion.samples), 8.0 * np.sin(9.0 * motion.q[:, 1]), np.zeros(motion.samples)])

    found = diagnose([process(production(arm.robot, cycles=15, extra=ripple).recording, arm.robot)], arm.structure)
    assert found.verdict in ("missing", "unexplained")
    assert found.remaining_rms["joint_2"] > 1.0


@pytest.mark.long
def test_the_cause_is_named_from_the_work_of_the_simulated_robot(arm: Any) -> None:
    """Stick-slip, servos and encoders included: eight cycles of ten moves, nothing designed for identification."""
    poses = np.concatenate([POSES, [[0.0, 0.9, 0.5], [0.5, 0.3, 1.1]]])
    shift = Shift(arm.robot, 8, 3, poses, (3, 2, 4, 1, 3, 1, 4, 5, 4, 2, 3))
    done = simulate(arm.robot, shift, sample_rate=125.0, effects=["stribeck@joint_2:25"], seed=2)
    measured = process(done.recording, arm.robot)
    assert measured.periods == 8
    model = estimate([measured], arm.structure)
    assert model.residual["joint_1"].noise_variance is not None
    assert model.residual["joint_1"].mse < 1.3 * model.residual["joint_1"].noise_variance
    assert [finding.label for finding in diagnose([measured], model.structure).missing] == ["stribeck@joint_2"]


def test_starts_that_jitter_little_are_no_period(arm: Any) -> None:
    """Pauses that vary by 20 ms look like a period that is not quite kept."""
    line = production(arm.robot, pause=(0.5, 0.52), cycles=12)
    measured = process(line.recording, arm.robot)
    assert measured.cycles is not None
    assert np.all(measured.position_variance < 1.5 * arm.robot.noise.position_variance)


def test_late_stamps_and_cycles_together(arm: Any) -> None:
    measured = process(production(arm.robot, cycles=10, late=1e-3).recording, arm.robot)
    assert measured.cycles is not None
    assert measured.stamps is not None
    assert measured.stamps.kind == "late"


def test_moves_that_do_not_repeat_have_no_floor(arm: Any) -> None:
    wandering = production(arm.robot, cycles=4, order=None).recording
    measured = process(wandering, arm.robot)
    assert measured.cycles is None
    assert measured.noise is None
    summary = summarise(wandering)
    assert summary.cycles is None
    assert summary.torque_variance is None
    assert any("no noise floor" in note for note in summary.notes)
    found = diagnose([measured], arm.structure)
    assert found.verdict == "not_decidable"
    assert any("record 8 or more periods" in note for note in found.notes)


def test_summary_counts_the_cycles(line: Line) -> None:
    summary = summarise(line.recording)
    assert summary.to_dict()["cycles"]["count"] == 39
    assert summary.period is None
    assert summary.torque_variance is not None


def test_a_gripper_that_never_moves_hides_no_cycle(line: Line) -> None:
    r = line.recording[slice(0, 12_000)]
    still = np.zeros((r.samples, 1))
    both = Recording((*r.names, "gripper"), r.t, np.hstack([r.q, still]), np.hstack([r.tau, still + 1.0]))
    cycles = summarise(both).cycles
    assert cycles is not None
    assert len(cycles.samples) == 5


def test_phase_is_the_place_in_the_mean_cycle(line: Line, measured: Measurement) -> None:
    assert measured.cycles is not None
    phase = measured.cycles.phase(line.recording.t)
    inside = np.isfinite(phase)
    assert inside.sum() > 0.7 * len(phase)
    grid = np.arange(measured.motion.samples) * measured.dt
    for joint in range(3):
        mean = np.interp(phase[inside], grid, measured.motion.q[:, joint])
        assert np.abs(mean - line.motion.q[inside, joint]).max() < 5e-3


def test_whoever_asks_for_one_pass_gets_it(arm: Any, line: Line) -> None:
    assert process(line.recording, arm.robot, Processing(periodic=False)).cycles is None


def test_gaps_in_a_cycle_do_not_spoil_the_mean(arm: Any) -> None:
    whole = production(arm.robot, cycles=12, seed=2).recording
    kept = np.random.default_rng(0).random(whole.samples) > 0.02
    holed: Recording = replace(whole, t=whole.t[kept], q=whole.q[kept], tau=whole.tau[kept])
    measured = process(holed, arm.robot)
    assert measured.periods == 11
    model = estimate([measured], arm.structure)
    z = (model.linear - arm.structure.true_values()) / model.std
    assert np.sqrt(np.mean(z**2)) < 1.7


def test_periods_are_asked_for_where_nothing_repeats(arm: Any) -> None:
    with pytest.raises(InputError, match="no period found"):
        process(production(arm.robot, cycles=4, order=None).recording, arm.robot, Processing(periodic=True))

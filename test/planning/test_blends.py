"""The excitation as it is played: from rest to rest, without a step, within the limits."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from robot_ident.errors import InputError
from robot_ident.limits.certifier import Certifier
from robot_ident.planning.blends import Playback
from robot_ident.provenance import config_file
from robot_ident.robot import Robot, load_robot
from robot_ident.trajectories.excitation import Excitation, Reference
from robot_ident.trajectories.fourier_series import FourierSeries


def check_continuous(reference: Reference, kuka: Robot, step: float = 2e-4) -> None:
    """Assert that q and dq have no step, that dq and ddq are their derivatives and that it begins and ends at rest."""
    t = np.arange(-0.5, reference.duration + 0.5, step)
    motion = reference.reference(t)
    np.testing.assert_allclose(np.diff(motion.q, axis=0) / step, (motion.dq[1:] + motion.dq[:-1]) / 2, atol=5e-4)
    steps = np.diff(motion.dq, axis=0) / step
    assert np.all(np.abs(steps) <= kuka.limits.acceleration * (1 + 1e-9)), "the velocity jumps"
    for state in (motion[:1], motion[-1:]):
        assert np.all(state.dq == 0.0)
        assert np.all(state.ddq == 0.0)
    np.testing.assert_allclose(motion.q[0], reference.start_pose, atol=1e-15)


@pytest.mark.parametrize("seed", range(6))
def test_no_step_and_within_the_limits(seed: int, kuka: Robot, random_excitation: Callable[..., Excitation]) -> None:
    excitation = random_excitation(seed, share=0.999)
    playback = Playback(excitation, kuka, 2)
    check_continuous(playback, kuka)
    t = np.linspace(0.0, playback.duration, 20_000)
    motion = playback.reference(t)
    assert np.all(np.abs(motion.ddq) < kuka.limits.acceleration)
    assert np.all(np.abs(motion.dq) < kuka.limits.velocity)
    jumps = np.abs(np.diff(motion.ddq, axis=0)).max()
    assert jumps < 0.1, "the acceleration jumps"


def test_the_steady_part_is_the_series(kuka: Robot, random_excitation: Callable[..., Excitation]) -> None:
    excitation = random_excitation(1)
    playback = Playback(excitation, kuka, 3)
    assert playback.transient == excitation.period
    t = np.linspace(0.0, 3 * excitation.period, 301)
    played, series = playback.reference(playback.transient + t), excitation.series.motion(t)
    np.testing.assert_allclose(played.q, series.q, atol=1e-12)
    np.testing.assert_allclose(played.ddq, series.ddq, atol=1e-11)
    before = playback.reference(np.array([playback.transient - 1e-6]))
    np.testing.assert_allclose(before.q[0], series.q[0], atol=1e-5)


def test_the_ramps_stay_on_the_certified_path(kuka: Robot, random_excitation: Callable[..., Excitation]) -> None:
    excitation = random_excitation(2)
    playback = Playback(excitation, kuka, 1)
    path = excitation.series.motion(np.linspace(0.0, excitation.period, 20_001)).q
    for t in np.concatenate([np.linspace(0, 10, 41), np.linspace(20, playback.duration, 21)]):
        q = playback.reference(np.array([t])).q[0]
        assert np.min(np.abs(path - q).max(axis=1)) < 1e-3


@pytest.mark.parametrize("seed", range(3))
def test_certified_margins_cover_the_blends(
    seed: int, kuka: Robot, random_excitation: Callable[..., Excitation]
) -> None:
    excitation = random_excitation(seed, share=0.999)
    playback, certifier = Playback(excitation, kuka, 1), Certifier(kuka)
    t = np.linspace(0.0, playback.duration, 50_000)
    motion = playback.reference(t)
    margins = {(m.quantity, m.where): m.margin for m in certifier.margins(playback).items}
    steady = {(m.quantity, m.where): m.margin for m in certifier.margins(excitation).items}
    for joint, name in enumerate(kuka.joints):
        found = float(np.min(kuka.limits.acceleration[joint] - np.abs(motion.ddq[:, joint])))
        assert found - 2e-3 <= margins["acceleration", name] <= found + 1e-12
        assert 0 < margins["acceleration", name] <= steady["acceleration", name] + 1e-12
        assert margins["velocity", name] == steady["velocity", name]


def test_a_ramp_of_ones_own_must_keep_the_limits(kuka: Robot, random_excitation: Callable[..., Excitation]) -> None:
    excitation = random_excitation(0, share=0.999)
    with pytest.raises(InputError, match="blend-in.*acceleration"):
        Playback(excitation, kuka, 1, ramp=0.05)
    with pytest.raises(InputError, match="ramp = 11"):
        Playback(excitation, kuka, 1, ramp=11.0)
    with pytest.raises(InputError, match="periods = 0"):
        Playback(excitation, kuka, 0)
    slow = random_excitation(0, share=0.3)
    assert Playback(slow, kuka, 1, ramp=4.0).duration == pytest.approx(24.0)


def test_another_robot(gantry: Robot, random_excitation: Callable[..., Excitation]) -> None:
    with pytest.raises(InputError, match="another robot"):
        Playback(random_excitation(0), gantry, 1)


def test_a_motion_is_played_wherever_its_period_begins() -> None:
    robot = load_robot()
    series = Excitation.read(config_file("paper", "c2.yaml")).series
    later = 0
    for shift in (0.0, 0.2, 0.45):
        angle = 2.0 * np.pi * shift * np.arange(1, series.harmonics + 1)
        a, b = series.a * np.cos(angle) + series.b * np.sin(angle), series.b * np.cos(angle) - series.a * np.sin(angle)
        moved = FourierSeries(series.base_frequency, series.q0, a, b)
        playback = Playback(Excitation(robot.name, robot.joints, moved, 150.0), robot, 2)
        check_continuous(playback, robot)
        assert Certifier(robot).keeps(playback)
        soon = np.array([0.1])
        later += bool(np.allclose(playback.reference(playback.steady_end + soon).dq, moved.motion(soon).dq, atol=1e-9))
    assert later, "of some the way out begins only after the period has ended"

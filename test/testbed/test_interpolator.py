"""From a stream of commands to a reference: smooth, exact on the commands, and to a stop when they end."""

from __future__ import annotations

import numpy as np
import pytest

from robot_ident.signals.motion import Array
from robot_ident.testbed.real_time import CommandInterpolator, braking, hermite, settling

PERIOD, HALF = 1 / 150, 1 / 3000
LIMIT = np.array([3.0, 6.0])


def wave(t: float | Array) -> tuple[Array, Array]:
    w, t = np.array([3.0, 5.0]), np.asarray(t)[..., None]
    return 0.2 * (1 - np.cos(w * t)), 0.2 * w * np.sin(w * t)


def play(interpolator: CommandInterpolator, arrivals: list[tuple[float, float]], duration: float) -> Array:
    """Return [N, 7]: time and q, dq, ddq, of commands with stamp and arrival time, advanced in cycles of one period."""
    rows, pending = [], list(arrivals)
    for cycle in range(round(duration / PERIOD)):
        now = cycle * PERIOD
        while pending and pending[0][1] <= now + 1e-9:
            stamp = pending.pop(0)[0]
            interpolator.push(100.0 + stamp, *wave(stamp))
        m = interpolator.advance(20, HALF)
        rows.append(np.column_stack([now + np.arange(1, 21) * HALF, m.q, m.dq, m.ddq]))
    return np.concatenate(rows)


def assert_smooth(rows: Array, acceleration: float) -> None:
    """Positions and velocities have no jump and belong to each other."""
    assert np.abs(np.diff(rows[:, 3:5], axis=0)).max() < acceleration * HALF
    trapezoidal = HALF * (rows[1:, 3:5] + rows[:-1, 3:5]) / 2
    np.testing.assert_allclose(np.diff(rows[:, 1:3], axis=0), trapezoidal, atol=acceleration * HALF**2)


def test_steady_stream_is_followed_one_period_late() -> None:
    interpolator = CommandInterpolator(LIMIT, PERIOD)
    rows = play(interpolator, [(k * PERIOD, k * PERIOD) for k in range(300)], 2.0)
    late = rows[:, 0] - PERIOD
    follows = late > 0
    q, dq = wave(late[follows])
    np.testing.assert_allclose(rows[follows, 1:3], q, atol=1e-8)
    np.testing.assert_allclose(rows[follows, 3:5], dq, atol=1e-5)
    assert_smooth(rows, 6.0)


def test_jitter_of_arrival_does_not_reach_the_reference() -> None:
    rng = np.random.default_rng(0)
    jitter = np.sort(np.arange(300) * PERIOD + rng.uniform(0.0, 0.9 * PERIOD, 300))
    rows = play(CommandInterpolator(LIMIT, 1.0 * PERIOD), [(k * PERIOD, jitter[k]) for k in range(300)], 2.0)
    assert_smooth(rows, 12.0)
    start = next(k for k in range(len(rows)) if rows[k, 3:5].any())
    delays = np.linspace(0, 0.03, 61)
    best = min(np.abs(rows[start:, 1:3] - wave(rows[start:, 0] - delay)[0]).max() for delay in delays)
    assert best < 2e-3


def test_when_commands_end_it_brakes_within_the_limits_and_holds() -> None:
    interpolator = CommandInterpolator(LIMIT, PERIOD)
    commands = [(k * PERIOD, k * PERIOD) for k in range(61)]  # joint 1 at 0.56 rad/s, joint 2 at 0.91
    rows = play(interpolator, commands, 2.5)
    stops = rows[rows[:, 0] > 60 * PERIOD + 2 * PERIOD]
    assert np.all(np.abs(stops[:, 5:7]) <= LIMIT * (1 + 1e-9))
    assert np.abs(stops[:, 5:7] / LIMIT).max() > 0.99, "not slower than need be"
    assert np.all(rows[-500:, 3:7] == 0)
    assert interpolator.holding
    assert_smooth(rows, 6.0)
    end = rows[-1, 1:3] - wave(60 * PERIOD)[0]
    assert np.all(end * wave(60 * PERIOD)[1] > 0), "it stops ahead, on its way"


def test_a_missing_command_is_bridged() -> None:
    commands = [(k * PERIOD, k * PERIOD) for k in range(300) if k % 50 != 20]
    rows = play(CommandInterpolator(LIMIT, PERIOD), commands, 1.9)
    assert_smooth(rows, 15.0)
    q, _ = wave(rows[:, 0] - PERIOD)
    assert np.abs(rows[20:, 1:3] - q[20:]).max() < 1e-3


def test_a_new_stream_is_joined_from_where_it_stands() -> None:
    interpolator = CommandInterpolator(LIMIT, PERIOD)
    interpolator.reset([0.3, -0.2])
    assert interpolator.holding
    np.testing.assert_array_equal(interpolator.advance(3, HALF).q, np.tile([0.3, -0.2], (3, 1)))
    assert interpolator.push(5.0, [0.301, -0.2], [0.0, 0.0])
    first = interpolator.advance(20, HALF)
    np.testing.assert_allclose(first.q[0], [0.3, -0.2], atol=3e-5)
    np.testing.assert_allclose(first.q[-1], [0.301, -0.2], atol=1e-12)
    interpolator.advance(200, HALF)
    assert interpolator.holding
    assert interpolator.push(1.0, [0.3005, -0.2], [0.0, 0.0]), "after a rest another clock may begin"


def test_old_and_broken_commands_are_left_out() -> None:
    interpolator = CommandInterpolator(LIMIT, PERIOD)
    assert interpolator.push(1.0, [0.0, 0.0], [0.1, 0.0])
    assert not interpolator.push(1.0, [0.0, 0.0], [0.1, 0.0])
    assert not interpolator.push(0.9, [0.0, 0.0], [0.1, 0.0])
    with pytest.raises(ValueError, match="not finite"):
        interpolator.push(2.0, [0.0, np.nan], [0.0, 0.0])


def test_commands_of_a_time_stood_still_are_left_out_smoothly() -> None:
    interpolator = CommandInterpolator(LIMIT, PERIOD)
    rows = [play(interpolator, [(k * PERIOD, k * PERIOD) for k in range(60)], 60 * PERIOD)]
    for k in range(60, 211):  # all at once, after a second in which nothing was played
        interpolator.push(100.0 + k * PERIOD, *wave(k * PERIOD))
    assert interpolator.behind == pytest.approx(151 * PERIOD)
    interpolator.catch_up()
    assert interpolator.behind == pytest.approx(PERIOD)
    for k in range(210, 710):
        interpolator.push(100.0 + k * PERIOD, *wave(k * PERIOD))
        m = interpolator.advance(20, HALF)
        rows.append(np.column_stack([(k - 1) * PERIOD + np.arange(1, 21) * HALF, m.q, m.dq, m.ddq]))
    all_rows = np.concatenate(rows)
    assert_smooth(all_rows, 12.0)
    q, dq = wave(all_rows[-2000:, 0])
    np.testing.assert_allclose(all_rows[-2000:, 1:3], q, atol=1e-8)
    np.testing.assert_allclose(all_rows[-2000:, 3:5], dq, atol=1e-5)


def test_a_backlog_that_is_played_is_played_in_order() -> None:
    interpolator = CommandInterpolator(LIMIT, PERIOD)
    for k in range(200):
        interpolator.push(k * PERIOD, *wave(k * PERIOD))
    m = interpolator.advance(199 * 20, HALF)
    np.testing.assert_allclose(m.q, wave(-PERIOD + HALF * np.arange(1, 199 * 20 + 1))[0].clip(0), atol=1e-3)


@pytest.mark.parametrize("speed", [-2.0, 0.0, 0.3])
def test_an_offset_settles_within_the_acceleration(speed: float) -> None:
    q, v = np.array([0.4, -0.1]), np.array([speed, 0.5])
    piece = settling(1.0, q, v, LIMIT)
    t = np.linspace(piece.start, piece.end, 2001)
    offset, rate, acceleration = piece.states(t)
    np.testing.assert_allclose(np.array([offset[0], rate[0], 0 * q]), [q, v, acceleration[0]], atol=1e-12)
    np.testing.assert_allclose(np.array([offset[-1], rate[-1], acceleration[-1]]), np.zeros((3, 2)), atol=1e-9)
    np.testing.assert_allclose(np.gradient(offset, t, axis=0)[1:-1], rate[1:-1], atol=1e-5)
    share = np.abs(acceleration).max(axis=0) / LIMIT
    assert share.max() <= 1.0
    assert share.max() > 0.5, "not slower than need be"


def test_pieces_meet_their_ends() -> None:
    piece = hermite(1.0, 1.5, (np.array([0.1]), np.array([2.0])), (np.array([0.7]), np.array([-1.0])))
    np.testing.assert_allclose(np.concatenate(piece.state(1.0)[:2]), [0.1, 2.0])
    np.testing.assert_allclose(np.concatenate(piece.state(1.5)[:2]), [0.7, -1.0])
    stop = braking(0.0, np.zeros(2), np.array([1.0, -0.5]), np.array([4.0, np.inf]))
    assert stop.end == pytest.approx(1.5 / 4)
    q, dq, ddq = stop.state(stop.end)
    np.testing.assert_allclose(q, np.array([1.0, -0.5]) * stop.end / 2)
    np.testing.assert_allclose([*dq, *ddq], 0.0, atol=1e-12)
    assert np.abs(stop.state(stop.end / 2)[2][0]) == pytest.approx(4.0)

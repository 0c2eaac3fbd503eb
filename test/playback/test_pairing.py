"""Efforts of other messages stand at the positions' stamps, as if both had been read from a bag."""

from __future__ import annotations

import numpy as np

from robot_ident.playback.stamps import Paired, Pairing

JOINTS = ("a", "b")
BEGIN = 1_700_000_000_000_000_000
MS = 1_000_000


def effort(t: float) -> float:
    return 3.0 + 2.0 * t  # a line, which interpolation gives back


def feed(
    pairing: Pairing, seconds: float, *, stamped: bool, late: int = 3 * MS, hole: tuple[float, float] = (9, 9)
) -> list[Paired]:
    """Hand positions at 100 Hz and efforts of b at 250 Hz over, in the order in which they come."""
    late = 3 * MS
    rows = [(round(k * 10 * MS) + late, 0, k * 0.01) for k in range(round(seconds * 100))]
    rows += [(round(k * 4 * MS) + late, 1, k * 0.004) for k in range(round(seconds * 250))]
    out = []
    for received, kind, t in sorted(rows):
        stamp = BEGIN + received - late
        if kind == 0:
            pairing.add_position(stamp, BEGIN + received, np.array([t, 2 * t]), np.array([7.0, np.nan]))
        elif not hole[0] < t < hole[1]:
            pairing.add_efforts(stamp if stamped else 0, BEGIN + received, {"b": effort(t)})
        out += pairing.take()
    return out


def test_efforts_are_interpolated_at_the_positions_stamps() -> None:
    for stamped in (True, False):
        out = feed(Pairing(JOINTS, ("b",)), 2.0, stamped=stamped)
        assert len(out) >= 198
        for one in out:
            t = (one.stamp_ns - BEGIN) / 1e9
            np.testing.assert_allclose(one.tau, [7.0, effort(t)], atol=1e-9)
            np.testing.assert_allclose(one.q, [t, 2 * t], atol=1e-9)
        stamps = [one.stamp_ns for one in out]
        assert stamps == sorted(set(stamps))


def test_a_hole_in_the_efforts_is_not_bridged_and_doesn_t_hold_up_what_follows() -> None:
    out = feed(Pairing(JOINTS, ("b",)), 4.0, stamped=True, hole=(1.0, 2.5))
    t = np.array([one.stamp_ns - BEGIN for one in out]) / 1e9
    assert not np.any((t > 1.01) & (t < 2.49))
    assert np.sum(t > 2.5) > 140


def test_without_sources_every_position_is_ready_at_once() -> None:
    pairing = Pairing(JOINTS, ())
    pairing.add_position(BEGIN, BEGIN + MS, np.zeros(2), np.ones(2))
    pairing.add_position(BEGIN + MS, BEGIN + 2 * MS, np.zeros(2), None)
    (one,) = pairing.take()
    np.testing.assert_array_equal(one.tau, [1.0, 1.0])
    assert pairing.take() == []


def test_stamps_that_go_back_begin_anew_and_nothing_grows() -> None:
    pairing = Pairing(JOINTS, ("b",))
    assert len(feed(pairing, 3.0, stamped=True)) > 290
    assert sum(map(len, pairing._efforts.values())) < 40
    again = feed(pairing, 2.0, stamped=True)  # the same stamps once more: a replay
    assert len(again) > 190
    silent = Pairing(JOINTS, ("b",))
    for k in range(1000):
        silent.add_position(BEGIN + k * 10 * MS, 0, np.zeros(2), np.zeros(2))
        assert silent.take() == []
    assert len(silent._waiting) <= 101

"""Stamps that stand still, stamps of samples that were held up, and stamps that no message can carry."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from robot_ident.bags import read_recording, write_recording
from robot_ident.errors import InputError
from robot_ident.recording.recording import Recording


def written(path: Path, t: np.ndarray, columns: int = 2) -> Path:
    """Write a table whose rows all differ, with these times."""
    rng = np.random.default_rng(0)
    q, tau = rng.normal(size=(2, len(t), columns))
    np.savez(path, t=t, q=q, tau=tau)
    return path


def test_samples_that_were_held_up_are_spread(tmp_path: Path) -> None:
    """Four times six samples wait and are then stamped together; none of them is a duplicate."""
    true = np.arange(600) / 150
    stamped = true.copy()
    for first in (50, 200, 350, 500):
        stamped[first : first + 6] = true[first + 5]
    got = read_recording(written(tmp_path / "a.npz", stamped))
    assert got.samples == 600
    np.testing.assert_allclose(got.t, true, atol=1e-9)
    assert "20 samples came late, with the stamp of another" in got.notes[0]


def test_samples_without_room_came_twice(tmp_path: Path) -> None:
    """Two senders on one topic now and then: the stamps leave no gap that the second would have come from."""
    t = np.sort(np.concatenate([np.arange(600) / 150, np.array([50, 200, 350]) / 150]))
    got = read_recording(written(tmp_path / "a.npz", t))
    assert got.samples == 600
    assert "3 samples have the stamp of another with different content" in got.notes[0]


@pytest.mark.parametrize("suffix", ["npz", "csv"])
def test_time_that_stands_still(tmp_path: Path, suffix: str) -> None:
    path = written(tmp_path / "a.npz", np.full(100, 3.0))
    if suffix == "csv":
        with np.load(path) as a:
            rows = np.column_stack([a["t"], a["q"][:, 0], a["tau"][:, 0]])
        np.savetxt(tmp_path / "a.csv", rows, delimiter=",", header="t,q_a,tau_a", comments="")
    with pytest.raises(InputError, match="all of its 100 samples have the same time"):
        read_recording(tmp_path / f"a.{suffix}")


def test_values_that_are_no_measurement(tmp_path: Path) -> None:
    t = np.arange(100) / 150
    tau = np.ones((100, 2))
    tau[7, 1] = 1e300
    with pytest.raises(InputError, match=r"tau of elbow is 1e\+300 at t = 0.047 s; that is no measurement"):
        Recording(("shoulder", "elbow"), t, np.ones((100, 2)), tau)
    with pytest.raises(InputError, match="are its times in seconds"):
        Recording(("shoulder", "elbow"), t * 1e12, np.ones((100, 2)), np.ones((100, 2)))


def test_times_before_1970_and_after_2038(tmp_path: Path) -> None:
    t = np.arange(100) / 150
    early = read_recording(written(tmp_path / "a.npz", t - 5e8))
    assert early.start_ns == 0, "no clock began before 1970"
    write_recording(tmp_path / "early", early)
    late = read_recording(written(tmp_path / "b.npz", t + 2.0**31))
    with pytest.raises(InputError, match="the stamps of ROS 2 end in 2038"):
        write_recording(tmp_path / "late", late)
    assert not (tmp_path / "late").exists()


def test_times_that_run_backwards(tmp_path: Path) -> None:
    """Whether each row stands beside its own time can't be seen, and sorting turns friction round where it doesn't."""
    with pytest.raises(InputError, match=r"a.npz: its times run backwards, from 3.993 to 0.000 s; sort its rows"):
        read_recording(written(tmp_path / "a.npz", np.arange(600)[::-1] / 150))

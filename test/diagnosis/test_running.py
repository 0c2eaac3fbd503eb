"""The running verdict: silent while nothing changes, whatever the model lacks; names what changed when it does."""

from __future__ import annotations

import numpy as np
import pytest

from robot_ident.residuals.change_monitor import RunningVerdict
from robot_ident.signals.motion import Array

RATE = 150.0
JOINTS = ("joint_1", "joint_2")


def course(seconds: float, seed: int, noise: float = 20.0) -> tuple[Array, Array, Array, Array]:
    """Return times, velocities, residual and torque of a periodic motion of a model that lacks something."""
    t = np.arange(round(seconds * RATE)) / RATE
    dq = np.column_stack([np.sin(2 * np.pi * 0.5 * t), np.cos(2 * np.pi * 0.5 * t) + 0.3 * np.sin(2 * np.pi * t)])
    lack = 6.0 * np.sin(4 * np.pi * 0.5 * t)[:, None] * [1.0, -1.0]
    residual = lack + noise * np.random.default_rng(seed).standard_normal(dq.shape)
    return t, dq, residual, residual + 150.0 * dq


@pytest.mark.parametrize("seed", range(20))
def test_nothing_is_said_while_nothing_changes(seed: int) -> None:
    verdict = RunningVerdict(JOINTS, 10.0)
    verdict.add(*course(60.0, seed))
    changes = verdict.changes()
    assert len(changes) == 2
    assert not any(change.changed(0.02) for change in changes)


def test_a_change_of_friction_is_told_at_its_joint_with_its_size() -> None:
    t, dq, residual, torque = course(60.0, 5)
    later = t > 30.0
    change = np.where(later, 9.0 * np.sign(dq[:, 1]), 0.0)
    residual[:, 1] += change
    torque[:, 1] += change
    verdict = RunningVerdict(JOINTS, 10.0)
    for rows in np.array_split(np.arange(len(t)), 200):  # as they come
        verdict.add(t[rows], dq[rows], residual[rows], torque[rows])
    first, second = verdict.changes()
    assert second.changed(0.02) and not first.changed(0.02)
    # 3 sigma: 20 Nm of noise on 1500 rows, twice, half of it shared with the viscous term
    assert second.coulomb == pytest.approx(9.0, abs=3 * 20 * np.sqrt(2 / 1500) * 2)
    assert "joint_2: coulomb +" in second.in_words


def test_memory_stays_bounded_and_bad_samples_are_left_out() -> None:
    import pickle

    verdict = RunningVerdict(JOINTS, 2.0)
    sizes = []
    for turn in range(6):
        t, dq, residual, torque = course(20.0, turn)
        residual[::50] = np.nan
        verdict.add(t + 20.0 * turn, dq, residual, torque)
        sizes.append(len(pickle.dumps(verdict)))
    assert max(sizes) < 1.05 * sizes[0]
    assert all(np.isfinite(change.rms) for change in verdict.changes())


def test_a_jump_of_time_begins_anew() -> None:
    verdict = RunningVerdict(JOINTS, 2.0)
    verdict.add(*course(10.0, 1))
    assert verdict.changes()
    t, dq, residual, torque = course(1.0, 2)
    verdict.add(t + 1000.0, dq, residual, torque)
    assert not verdict.changes()

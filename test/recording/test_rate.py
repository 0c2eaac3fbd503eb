"""Rates too low for the motion are said, rates that do are not."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from robot_ident.planning.validation_motion import moves
from robot_ident.recording import Recording
from robot_ident.recording.clock import rate_note
from robot_ident.recording.summary import summarise

POINTS = np.array([[0, 0, 0], [1, 0.5, -0.5], [0.3, -0.4, 0.8], [-1, 0.2, 0.1], [0, 0, 0]] * 4)


@pytest.mark.parametrize("noise", [0.0, 1e-4])
@pytest.mark.parametrize(("rate", "slow"), [(500.0, False), (125.0, False), (50.0, False), (10.0, True), (5.0, True)])
def test_a_rate_is_called_too_low_where_it_is(arm: Any, rate: float, slow: bool, noise: float) -> None:
    motion = moves(arm.robot, POINTS, pause=0.5)
    t = np.arange(0.0, motion.duration, 1.0 / rate)
    q = motion.reference(t).q + noise * np.random.default_rng(0).normal(size=(len(t), 3))
    note = rate_note(q, 1.0 / rate, arm.robot.joints)
    assert bool(note) == slow
    told = summarise(Recording(arm.robot.joints, t, q, q)).notes
    assert any("too low a rate" in line for line in told) == slow


def test_a_rate_a_little_below_100_hz_is_no_trouble() -> None:
    """Nearly no lines lie between a fifth of it and the fastest that an arm moves."""
    rate = 99.999
    t = np.arange(2000) / rate
    q = np.column_stack([np.sin(2 * np.pi * 0.3 * t)] * 3)
    assert rate_note(q, 1.0 / rate, ("a", "b", "c")) == ""

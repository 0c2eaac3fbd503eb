"""Held joints: their angle is read off the recording, and only the part counts in which they stand."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from robot_ident.errors import InputError
from robot_ident.recording.checks import held_angles, still_part


def held(arm: Any, moved: float = 0.0) -> Any:
    """Return a recording in which joint_1 stands at 0.4 but for its first `moved` seconds."""
    recording = arm.record(1, periods=2)
    q = np.array(recording.q)
    q[:, 0] = 0.4 + 1e-4 * np.sin(np.arange(len(q)))
    begin = recording.t - recording.t[0] < moved
    q[begin, 0] = 0.4 + 0.2 * (recording.t[begin] - recording.t[0] - moved) / max(moved, 1e-9) - 0.05
    return replace(recording, q=q)


def test_the_angle_is_where_it_stands(arm: Any) -> None:
    assert held_angles(held(arm, 5.0), ["joint_1"], {})["joint_1"] == pytest.approx(0.4, abs=1e-3)


def test_the_approach_is_cut(arm: Any) -> None:
    recording = held(arm, 5.0)
    part = still_part(recording, {"joint_1": 0.4})
    assert part.duration == pytest.approx(recording.duration - 5.0, abs=0.05)
    assert any("in which joint_1 moved" in note for note in part.notes)
    assert still_part(held(arm), {"joint_1": 0.4}).samples == recording.samples


def test_a_joint_that_moves_is_not_held(arm: Any) -> None:
    recording = arm.record(1, periods=2)
    angles = held_angles(recording, ["joint_1"], {})
    with pytest.raises(InputError, match="joint_1 is to be held but moves by"):
        still_part(recording, angles)


def test_an_angle_that_is_not_recorded_has_to_be_given(arm: Any) -> None:
    recording = held(arm).with_joints(("joint_2", "joint_3"))
    with pytest.raises(InputError, match="--hold joint_1=ANGLE"):
        held_angles(recording, ["joint_1"], {})
    assert held_angles(recording, ["joint_1"], {"joint_1": 0.1}) == {"joint_1": 0.1}
    with pytest.raises(InputError, match=r"stands at 0\.4.*not at 0\.1"):
        held_angles(held(arm), ["joint_1"], {"joint_1": 0.1})

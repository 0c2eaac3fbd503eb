"""What is played, and what goes before it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from robot_ident.errors import InputError
from robot_ident.planning.validation_motion import validation_motion
from robot_ident.playback.plan import load_plan
from robot_ident.trajectories.excitation import Excitation
from robot_ident.trajectories.fourier_series import FourierSeries


@pytest.fixture
def played(arm: Any, tmp_path: Path) -> Path:
    path, series = tmp_path / "excitation.yaml", arm.series
    slow = FourierSeries(0.1, series.q0, 0.6 * series.a, 0.6 * series.b)
    Excitation("kuka_ir361", arm.robot.joints, slow, 150.0).write(path)
    return path


def test_rehearsals_go_from_slow_to_fast(arm: Any, played: Path) -> None:
    plan = load_plan(played, arm.robot, periods=2, rehearsals=[0.1, 0.3, 0.3])
    assert [one.speed for one in plan.rehearsals] == [0.1, 0.3, 0.3]
    assert load_plan(played, arm.robot, periods=2, rehearsals=[0.0]).rehearsals == ()
    with pytest.raises(InputError, match=r"rehearsal = \[0.3, 0.1\]: slow ones come first.*\[0.1, 0.3\]"):
        load_plan(played, arm.robot, periods=2, rehearsals=[0.3, 0.1])


def test_a_motion_that_ends_elsewhere_has_no_rehearsal(arm: Any, tmp_path: Path) -> None:
    """Played twice in a row it would leap from its end to its start."""
    path = tmp_path / "validation.yaml"
    validation_motion(arm.robot, 3, points=5).write(path)
    with pytest.raises(InputError, match=r"validation.yaml ends .* from its start at joint_.*can't be played twice"):
        load_plan(path, arm.robot, periods=1, rehearsals=[0.5])
    assert load_plan(path, arm.robot, periods=1, rehearsals=[0.0], speed=0.5).rehearsals == ()

"""A design from recordings stays within what was run: position, speed, acceleration, tool."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from robot_ident.errors import InputError
from robot_ident.limits.certifier import certify
from robot_ident.limits.envelope import tool_volume, within_envelope
from robot_ident.signals.motion import Motion
from robot_ident.trajectories.excitation import Excitation
from robot_ident.trajectories.fourier_series import FourierSeries


def run_before(arm: Any, share: float = 0.5) -> Motion:
    """Return a motion of the arm, slower and smaller than its limits."""
    return FourierSeries(0.1, arm.series.q0, share * arm.series.a, share * arm.series.b).motion(np.arange(2000) / 200.0)


def within(robot: Any, *motions: Motion) -> Any:
    places = [robot.rigid.frame_position(motion.q, robot.end_effector) for motion in motions]
    return within_envelope(robot, motions, np.concatenate(places))


def test_the_limits_are_those_of_the_motion(arm: Any) -> None:
    motion = run_before(arm)
    limits = within(arm.robot, motion).limits
    np.testing.assert_allclose(limits.upper, np.minimum(motion.q.max(axis=0), arm.robot.limits.upper))
    np.testing.assert_allclose(limits.velocity, np.abs(motion.dq).max(axis=0))
    np.testing.assert_allclose(limits.acceleration, np.abs(motion.ddq).max(axis=0))
    assert np.all(limits.torque == arm.robot.limits.torque)


def test_several_recordings_make_one_envelope(arm: Any) -> None:
    small, large = run_before(arm, 0.3), run_before(arm, 0.5)
    both, one = within(arm.robot, small, large), within(arm.robot, large)
    np.testing.assert_allclose(both.limits.velocity, one.limits.velocity)


@pytest.mark.parametrize(("share", "joints_broken"), [(0.45, False), (0.55, True)])
def test_a_smaller_motion_keeps_the_envelope_and_a_larger_one_breaks_it(
    arm: Any, share: float, joints_broken: bool
) -> None:
    inside = within(arm.robot, run_before(arm))
    series = FourierSeries(0.1, arm.series.q0, share * arm.series.a, share * arm.series.b)
    margins = certify(Excitation("kuka_ir361", arm.robot.joints, series, 150.0), inside)
    broken = {item.quantity for item in margins.violations}
    assert broken >= {"position", "velocity", "acceleration", "workspace"} if joints_broken else broken <= {"workspace"}


def test_the_tool_stays_where_it_has_been(arm: Any) -> None:
    motion = run_before(arm)
    places = arm.robot.rigid.frame_position(motion.q, arm.robot.end_effector)
    rule = tool_volume(arm.robot.end_effector, places)
    assert rule.margin(places).min() > -1e-9
    assert len(rule.clauses) == 14
    beyond = places + np.array([0.0, 0.0, 2.0])
    assert np.all(rule.margin(beyond) < 0.0)


def test_limits_that_the_files_lack_are_given(arm: Any, checkout: Any) -> None:
    from robot_ident.robot import load_robot

    bare = load_robot(checkout / "config/robots/kuka_ir361.urdf")
    assert not np.isfinite(bare.limits.acceleration).any()
    assert np.isfinite(within(bare, run_before(arm)).limits.acceleration).all()


def test_a_joint_that_hardly_moved_is_named_with_the_way_out(arm: Any) -> None:
    motion = run_before(arm)
    q = np.array(motion.q)
    q[:, 1] = 0.3
    with pytest.raises(InputError, match="joint_2 hardly moves.*--joints joint_1,joint_3"):
        within(arm.robot, Motion(q, motion.dq, motion.ddq))

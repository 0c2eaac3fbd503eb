"""Efforts that the motion didn't make are told from those that it did, and a wrong gravity from wrong masses."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from robot_ident import diagnose, identify
from robot_ident.errors import InputError
from robot_ident.estimation.declaration import judge_measured
from robot_ident.estimation.effort_checks import EffortChecks, EffortRows, paces_apart, undecided_directions
from robot_ident.recording.measurement import Processing
from robot_ident.recording.process import process
from robot_ident.signals.motion import Motion


@pytest.fixture(scope="module")
def recording(arm: Any) -> Any:
    return arm.record(1, periods=4, lead=0.0)


@pytest.fixture(params=[None, False], ids=["periods", "one pass"])
def measured(request: pytest.FixtureRequest, arm: Any) -> Any:
    def give(recording: Any, robot: Any = None) -> list[Any]:
        return [process(recording, robot or arm.robot, Processing(periodic=request.param))]

    return give


def under(robot: Any, gravity: list[float]) -> Any:
    """Return a robot whose YAML declares another gravity."""
    model = robot.rigid.model.copy()
    model.gravity.linear = np.array(gravity)
    return replace(robot, rigid=type(robot.rigid)(model))


def test_the_robot_itself(arm: Any, recording: Any, measured: Any) -> None:
    there = measured(recording)
    assert EffortChecks(there, arm.robot).foreign() == "" and EffortChecks(there, arm.robot).exchanged() == ""
    assert EffortChecks(there, arm.robot).gravity() is None


@pytest.mark.parametrize("share", [1.0, 0.01])
def test_noise(arm: Any, recording: Any, measured: Any, share: float) -> None:
    noise = np.random.default_rng(3).normal(size=recording.tau.shape) * recording.tau.std(axis=0) * share
    told = EffortChecks(measured(replace(recording, tau=noise)), arm.robot).foreign()
    assert all(joint in told for joint in arm.robot.joints) and "not made by the motion" in told
    one = np.array(recording.tau)
    one[:, 1] = noise[:, 1]
    told = EffortChecks(measured(replace(recording, tau=one)), arm.robot).foreign()
    assert [joint in told for joint in arm.robot.joints] == [False, True, False]


def test_the_library_refuses_what_the_command_line_refuses(arm: Any, recording: Any, measured: Any) -> None:
    noise = np.random.default_rng(3).normal(size=recording.tau.shape) * recording.tau.std(axis=0)
    spoilt = replace(recording, tau=noise)
    with pytest.raises(InputError, match="not made by the motion.*as_declared=True"):
        identify([spoilt], arm.robot)
    assert any("taken as declared" in note for note in identify([spoilt], arm.robot, as_declared=True).notes)
    structure = identify([recording], arm.robot).structure
    with pytest.raises(InputError, match="not made by the motion"):
        diagnose([process(spoilt, arm.robot)], structure)
    other = under(arm.robot, [0.0, 0.0, 9.81])
    with pytest.raises(InputError, match="gravity"):
        identify([recording], other)


def test_absolute_values(arm: Any, recording: Any, measured: Any) -> None:
    told = EffortChecks(measured(replace(recording, tau=np.abs(recording.tau))), arm.robot).foreign()
    assert "absolute values" in told
    lifted = recording.tau + 1.2 * np.abs(recording.tau).max(axis=0)
    assert EffortChecks(measured(replace(recording, tau=lifted)), arm.robot).foreign() == "", "an offset is none"


def test_all_joints_without_a_sign_stand_in_one_line(arm: Any, recording: Any, measured: Any) -> None:
    """One of them is so far from its model that no reading of its effort fits: it is named beside the others."""
    t = recording.t
    far = np.array(recording.tau)
    far[:, 1] += 1.2 * np.abs(far[:, 1]).max() * np.sin(2 * np.pi * 0.3 * t)
    told = EffortChecks(measured(replace(recording, tau=np.abs(far))), arm.robot).foreign()
    assert told.count("never changes its sign") == 1
    assert "all 3 joints that move (joint_1, joint_2, joint_3)" in told
    assert "record effort with its sign" in told and "not made by the motion" not in told
    one = np.array(recording.tau)
    one[:, 2] = np.abs(one[:, 2])
    told = EffortChecks(measured(replace(recording, tau=one)), arm.robot).foreign()
    assert "the effort of joint_3 never changes its sign" in told and "joint_1" not in told


def test_exchanged(arm: Any, recording: Any, measured: Any) -> None:
    told = EffortChecks(measured(replace(recording, tau=recording.tau[:, [0, 2, 1]])), arm.robot).exchanged()
    assert "joint_2 follows the motion of joint_3" in told and "joint_3 follows the motion of joint_2" in told
    assert "joint_1" not in told


@pytest.mark.parametrize("gravity", [[0.0, 0.0, 9.81], [0.0, 0.0, -1.62], [9.81, 0.0, 0.0], [0.0, 0.0, 0.0]])
def test_another_gravity(arm: Any, recording: Any, measured: Any, gravity: list[float]) -> None:
    robot = under(arm.robot, gravity)
    found = EffortChecks(measured(recording, robot), robot).gravity()
    assert found is not None and found.change == "gravity: [0, 0, -9.81]"


@pytest.mark.parametrize("gravity", [(0.0, 0.0, 9.81), (0.0, 9.81, 0.0), (9.81, 0.0, 0.0)])
def test_the_gravity_of_a_recordings_conditions_is_judged_where_it_stands(
    arm: Any, recording: Any, tmp_path: Path, gravity: tuple[float, float, float]
) -> None:
    """By the effort as it was measured: what the URDF says of the declared gravity has been taken off it."""
    conditions = replace(recording.conditions, gravity=gravity)
    (tmp_path / "a.conditions.yaml").write_text(conditions.text())
    declared = replace(recording, conditions=conditions, source=str(tmp_path / "a.npz"))
    with pytest.raises(
        InputError, match=r"a\.conditions\.yaml:2: gravity is .* change it to 'gravity: \[0, 0, -9.81\]'"
    ):
        identify([arm.record(2, periods=4, lead=0.0), declared], arm.robot)


def test_what_is_no_other_gravity(arm: Any, recording: Any, measured: Any) -> None:
    """A sign, a gain, a tilted base, masses wrong by a third, one joint whose weight is balanced."""
    for tau in (-recording.tau, 3.0 * recording.tau, recording.tau * [1.0, 1.3, 0.7]):
        assert EffortChecks(measured(replace(recording, tau=tau)), arm.robot).gravity() is None
    for gravity in ([0.0, 2.0, -9.6], [0.0, 0.0, -7.0], [0.0, 0.0, -13.0]):
        robot = under(arm.robot, gravity)
        assert EffortChecks(measured(recording, robot), robot).gravity() is None, gravity


def test_weight_that_the_driver_takes_out_is_no_other_gravity(arm: Any, recording: Any, measured: Any) -> None:
    """`identify`, `info` and `init` take the same advice from here; another gravity of no size is none."""
    still = np.zeros_like(recording.q)
    weight = arm.robot.rigid.inverse_dynamics(Motion(recording.q, still, still))
    found = EffortChecks(measured(replace(recording, tau=recording.tau - weight)), arm.robot).declaration()
    assert found is not None
    assert (found.entry, found.change) == ("effort.gravity", "effort: {gravity: removed}")
    found = EffortChecks(measured(replace(recording, tau=recording.tau - 0.8 * weight)), arm.robot).declaration()
    assert found is None or found.change == "effort: {gravity: removed}"
    with pytest.raises(InputError, match="effort.gravity is included, .* change it to 'effort: {gravity: removed}'"):
        identify([replace(recording, tau=recording.tau - weight)], arm.robot)


def test_a_mirrored_arm_is_not_decidable(arm: Any, recording: Any, measured: Any) -> None:
    """Axis 1 stands upright; axes 2 and 3 carry weight that tells."""
    told = undecided_directions(measured(recording)[0], arm.robot)
    assert "joint_1" in told and "joint_3" not in told
    turn = [-1.0, 1.0, 1.0]
    mirrored = replace(recording, q=recording.q * turn, tau=recording.tau * turn, dq=None)
    assert "joint_1" in undecided_directions(measured(mirrored)[0], arm.robot)


def test_efforts_of_another_time(arm: Any, recording: Any, measured: Any) -> None:
    """A second late, or a second lost amid the recording: the motion didn't make them at its time."""
    second, half = round(1.0 / np.median(np.diff(recording.t))), len(recording.t) // 2
    late = np.roll(recording.tau, second, axis=0)
    lost = np.concatenate([recording.tau[:half], np.roll(recording.tau, -second, axis=0)[half:]])
    told = EffortChecks(measured(replace(recording, tau=late)), arm.robot).foreign()
    assert "not of the same time as the positions" in told
    assert "shifted by -1 s" in told or "shifted by +9 s" in told, "or by that and a period of 10 s"
    told = EffortChecks(measured(replace(recording, tau=lost)), arm.robot).foreign()
    assert "shifted by +1 s" in told if "period" in told else "not made by the motion" in told


def test_stamps_far_too_slow(arm: Any, recording: Any, measured: Any) -> None:
    """Rows that stand farther apart than efforts may be late leave nothing but the rows themselves as near."""
    slow = replace(recording, t=recording.t * 50.0)
    assert "not of the same time" not in EffortChecks(measured(slow), arm.robot).foreign()
    late = replace(slow, tau=np.roll(slow.tau, len(slow.t) // 3, axis=0))
    assert "not of the same time" in EffortChecks(measured(late), arm.robot).foreign()


def test_efforts_of_another_run(arm: Any, measured: Any) -> None:
    """Of two runs of one period chance makes some efforts follow the other motion in part: most are told, none of its
    own run is.
    """
    told = []
    for seed in range(8):
        draw = np.random.default_rng(seed)
        shapes = [0.3 * draw.normal(size=(2, *arm.series.a.shape)) for _ in range(2)]
        arms = [replace(arm, series=replace(arm.series, a=a, b=b)) for a, b in shapes]
        own, other = (one.record(seed, periods=3, lead=0.0) for one in arms)
        assert EffortChecks(measured(own), arm.robot).foreign() == ""
        told.append(EffortChecks(measured(replace(own, tau=other.tau)), arm.robot).foreign())
    assert sum(map(bool, told)) >= 6


@pytest.mark.parametrize("share", [0.0, 1.5])
def test_what_the_robot_does_late_or_beside_its_model_is_of_the_same_time(
    arm: Any, recording: Any, measured: Any, share: float
) -> None:
    """A delay of a tenth of a second, and a torque as large as the arm's own that no column knows."""
    late = np.roll(recording.tau, round(0.1 / np.median(np.diff(recording.t))), axis=0)
    unknown = share * recording.tau.std(axis=0) * np.sin(3.0 * recording.q[:, [1, 2, 0]])
    assert EffortChecks(measured(replace(recording, tau=late + unknown)), arm.robot).foreign() == ""


def test_recordings_whose_clocks_run_at_different_paces(arm: Any, recording: Any) -> None:
    other = arm.record(2, periods=4, lead=0.0)
    slow = replace(other, t=other.t[0] + (other.t - other.t[0]) / 1.25, dq=None, source="slow.npz")
    with pytest.raises(InputError, match=r"the stamps of .* run 1\.2\d? times as fast as those of slow\.npz"):
        identify([recording, slow], arm.robot)
    both = identify([recording, other], arm.robot)
    with pytest.raises(InputError, match="as fast as those of slow"):
        diagnose([process(recording, arm.robot), process(slow, arm.robot)], both.structure)
    heavier = replace(other, tau=1.5 * other.tau)
    rows = [process(one, arm.robot) for one in (recording, heavier)]
    assert EffortChecks(rows, arm.robot).clocks_apart() == "", "a gain multiplies weight as well"


def test_what_changes_inertia_and_no_pace_of_the_clock_explains_is_no_clock(arm: Any, recording: Any) -> None:
    """A mass that sloshes makes inertia seem larger in one motion than in another; the rows decide."""
    other = arm.record(2, periods=4, lead=0.0)
    slow = replace(other, t=other.t[0] + (other.t - other.t[0]) / 1.2, dq=None)
    sound, paced = ([process(one, arm.robot) for one in (recording, second)] for second in (other, slow))
    judged = [judge_measured(one, arm.robot) for one in paced]
    assert paces_apart([EffortRows(one, arm.robot) for one in paced], judged)
    assert paces_apart([EffortRows(one, arm.robot) for one in sound], judged) == ""

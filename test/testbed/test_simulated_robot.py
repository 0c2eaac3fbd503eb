"""The robot of the real-time node: the same plant, a few steps at a time."""

from __future__ import annotations

import numpy as np
import pytest

from robot_ident.errors import InputError
from robot_ident.robot import Robot
from robot_ident.signals.motion import Motion
from robot_ident.testbed.real_time import SimulatedRobot
from robot_ident.testbed.simulation import simulate


@pytest.mark.parametrize("servo", ["feedforward", "pd"])
def test_it_is_the_plant_of_simulate(kuka: Robot, blend, servo: str) -> None:
    reference = blend(kuka, 6.0)
    offline = simulate(kuka, reference, servo=servo)
    robot = SimulatedRobot(kuka, servo=servo)
    robot.reset(reference.start_pose)
    half = robot.step / 2
    for sample in range(1, 900):
        begin = (sample - 1) * robot.steps_per_sample * 2
        t = (begin + 1 + np.arange(2 * robot.steps_per_sample)) * half
        robot.advance(reference.reference(t))
        if sample % 100 == 0:
            np.testing.assert_allclose(robot.motion.q[0], offline.exact.q[sample], atol=1e-9)
            np.testing.assert_allclose(robot.motion.ddq[0], offline.exact.ddq[sample], atol=1e-4)
            np.testing.assert_allclose(robot.torque, offline.torque[sample], atol=1e-3)


def test_hold_stands_still(kuka: Robot) -> None:
    robot = SimulatedRobot(kuka)
    pose = np.array([0.3, -0.4, 0.5])
    robot.reset(pose)
    robot.hold(1500)
    np.testing.assert_array_equal(robot.motion.q[0], pose)
    np.testing.assert_array_equal(robot.motion.dq[0], 0.0)
    still = Motion(pose[None], np.zeros((1, 3)), np.zeros((1, 3)))
    np.testing.assert_allclose(robot.torque, kuka.rigid.inverse_dynamics(still)[0], atol=1e-9)


def test_hold_brings_a_moving_robot_to_rest(kuka: Robot) -> None:
    robot = SimulatedRobot(kuka)
    robot.reset(np.zeros(3))
    t = np.arange(1, 1501)[:, None] * robot.step / 2 * np.ones(3)
    robot.advance(Motion(0.5 * t**2, t, np.ones_like(t)))
    goal = robot.reference.q[0]
    robot.hold(3000)
    np.testing.assert_allclose(robot.motion.q[0], goal, atol=2e-3)
    np.testing.assert_allclose(robot.motion.dq[0], 0.0, atol=1e-9)


def test_readings_have_noise_and_steps(kuka: Robot) -> None:
    robot = SimulatedRobot(kuka)
    rng = np.random.default_rng(0)
    readings = [robot.measure(rng) for _ in range(3000)]
    tau = np.array([reading.tau for reading in readings])
    np.testing.assert_allclose(tau.var(axis=0), [400, 416, 160], rtol=0.1)
    q = np.array([reading.q for reading in readings]) / kuka.drives.encoder_step
    np.testing.assert_allclose(q, np.round(q), atol=1e-6)
    assert np.all(np.array([reading.dq for reading in readings]).std(axis=0) > 1e-3)


def test_what_is_no_pose_or_reference_is_refused(kuka: Robot) -> None:
    robot = SimulatedRobot(kuka)
    with pytest.raises(InputError, match="a pose of 3 finite positions"):
        robot.reset([0.0, 1.0])
    with pytest.raises(InputError, match="a pose of 3 finite positions"):
        robot.reset([0.0, np.nan, 1.0])
    with pytest.raises(ValueError, match="got 3 instants"):
        robot.advance(Motion(*np.zeros((3, 3, 3))))

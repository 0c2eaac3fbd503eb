"""Effects that displace the links or tilt gravity, against differences, Pinocchio and a simulated twisting shaft."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pinocchio
import pytest

from robot_ident.effects import make_effect
from robot_ident.model.rigid_sensitivity import RigidSensitivity, standard_parameters
from robot_ident.model.structure import Structure
from robot_ident.robot import Robot
from robot_ident.robot.symbolic import force_function
from robot_ident.signals.motion import Array, Motion
from robot_ident.trajectories.fourier_series import FourierSeries

ARMS = ("kuka", "six_axes")


def other_values(at: Any) -> Array:
    """Return base parameters that are not the URDF's."""
    count = len(at.structure.base.columns)
    return at.values[:count] * np.random.default_rng(2).uniform(0.7, 1.3, count)


@pytest.mark.parametrize("arm", ARMS)
def test_displacement_against_differences(arm: str, case: Callable[[str], Any]) -> None:
    at = case(arm)
    values, motion, n = other_values(at), at.motion[::20], at.robot.n
    e = 1e-5 * np.random.default_rng(4).normal(size=(3, motion.samples, n))

    def torque(sign: float) -> Array:
        moved = Motion(motion.q + sign * e[0], motion.dq + sign * e[1], motion.ddq + sign * e[2])
        return at.structure.rigid_columns(moved) @ values

    found = RigidSensitivity(at.robot, at.structure.base, values, motion).displaced(Motion(*e))
    difference = (torque(1.0) - torque(-1.0)) / 2
    np.testing.assert_allclose(found, difference, atol=1e-6 * np.abs(difference).max())


@pytest.mark.parametrize("arm", ARMS)
def test_a_joint_that_stands_elsewhere_against_differences(arm: str, case: Callable[[str], Any]) -> None:
    """Torque of an arm whose second joint's origin has moved, by recursive Newton-Euler: quadratic in the distance."""
    at, joint, step = case(arm), 1, 1e-2
    values, motion = other_values(at), at.motion[::20]
    standard = standard_parameters(at.robot, at.structure.base, values)

    def torque(shift: Array) -> Array:
        model = at.robot.rigid.model.copy()
        model.armature = np.zeros(at.robot.n)
        for link, ten in enumerate(standard):
            model.inertias[1 + link] = pinocchio.Inertia.FromDynamicParameters(ten)
        placement = model.jointPlacements[1 + joint]
        placement.translation = placement.translation + shift
        data, paths = model.createData(), zip(motion.q, motion.dq, motion.ddq, strict=True)
        return np.array([pinocchio.rnea(model, data, *x) for x in paths])

    found = RigidSensitivity(at.robot, at.structure.base, values, motion).mounted(joint)
    axes = step / 2 * np.eye(3)
    difference = np.stack([(torque(axis) - torque(-axis)) / step for axis in axes], axis=2)
    assert np.abs(difference).max() > 1.0
    np.testing.assert_allclose(found, difference, atol=1e-9 * np.abs(difference).max())


STIFF = {"resonance": 200.0, "damping": 0.005}
"""A gear that follows its load at once."""


@pytest.mark.parametrize("arm", ARMS)
@pytest.mark.parametrize("name", ["encoder_eccentricity", "joint_elasticity"])
def test_displaced_links_change_the_torque(arm: str, name: str, case: Callable[[str], Any]) -> None:
    at, amount = case(arm), 1e-3
    eccentric = name == "encoder_eccentricity"
    effect = make_effect(f"{name}@{at.robot.joints[1]}", at.robot, {"h": 2.0} if eccentric else STIFF)
    effect = effect.at({"rotor": 0.0}) if "rotor" in effect.setting else effect
    shift = np.zeros_like(at.motion.q)
    held = not eccentric and arm == "kuka"  # its links' inertias hold the second motor's, which does not twist
    rotor = np.array([0.0, at.robot.drives.armature[1] if held else 0.0, *[0.0] * (at.robot.n - 2)])
    load = at.torques.load - rotor * at.motion.ddq
    shift[:, 1] = 1e-3 * np.cos(2 * at.motion.q[:, 1]) if eccentric else 1e-6 * load[:, 1]
    shift *= amount

    def along(x: Array) -> Array:
        w = 2j * np.pi * np.fft.rfftfreq(len(x), at.motion.dt)[:, None]
        return np.fft.irfft(w * np.fft.rfft(x, axis=0), len(x), axis=0)

    true = Motion(at.motion.q - shift, at.motion.dq - along(shift), at.motion.ddq - along(along(shift)))
    rigid = at.values[: len(at.structure.base.columns)]
    change = (at.structure.rigid_columns(true) - at.structure.rigid_columns(at.motion)) @ rigid
    change -= rotor * (true.ddq - at.motion.ddq)
    found = amount * effect.columns(at.motion, at.torques)[:, :, 0]
    np.testing.assert_allclose(found, change, atol=1e-3 * np.abs(change).max())


@pytest.mark.parametrize("arm", ARMS)
def test_tilted_base_against_pinocchio(arm: str, case: Callable[[str], Any]) -> None:
    at, gx, gy = case(arm), 0.12, -0.05
    model = at.robot.rigid.model.copy()
    model.gravity.linear = np.array([gx, gy, -9.81])
    data, m = model.createData(), at.motion
    tilted = np.array([pinocchio.rnea(model, data, *x) for x in zip(m.q, m.dq, m.ddq, strict=True)])
    change = tilted - at.robot.rigid.inverse_dynamics(m)
    found = make_effect("base_tilt", at.robot).columns(m, at.torques) @ [gx, gy]
    np.testing.assert_allclose(found, change, atol=1e-6 * np.abs(change).max())


@pytest.mark.parametrize("arm", [*ARMS, "slide"])
def test_an_external_force_against_pinocchio(arm: str, case: Callable[[str], Any]) -> None:
    """Inverse dynamics of the arm with the force on its link, less those without; columns that are left out lead to
    the torque of links or of the others.
    """
    at, force, k = case(arm), np.array([8.0, -3.0, 5.0]), 12.0
    model, motion, n = at.robot.rigid.model, at.motion[::20], at.robot.n
    data = model.createData()
    for joint in range(n):
        last = joint + 1 == n
        frame = model.getFrameId(at.robot.end_effector) if last else None
        end = model.frames[frame].placement if last else model.jointPlacements[joint + 2]
        expected = np.empty((motion.samples, n))
        for row, *x in zip(expected, motion.q, motion.dq, motion.ddq, strict=True):
            pinocchio.forwardKinematics(model, data, x[0])
            here = data.oMi[joint + 1] * end
            pull = pinocchio.Force(here.rotation.T @ (force - k * here.translation), np.zeros(3))
            outside = [pinocchio.Force.Zero() for _ in range(n + 1)]
            outside[joint + 1] = end * pull
            row[:] = pinocchio.rnea(model, data, *x, outside) - pinocchio.rnea(model, data, *x)
        found = np.array(force_function(at.robot, joint)(motion.q.T)).reshape(n, -1, 4).swapaxes(0, 1)
        np.testing.assert_allclose(found @ [*force, k], expected, atol=1e-9 * max(np.abs(expected).max(), 1.0))


def test_a_tilt_is_measured_across_gravity(kuka: Any) -> None:
    directions = make_effect("base_tilt", kuka.robot).directions()
    np.testing.assert_allclose(directions, np.eye(3)[:2])


@pytest.mark.parametrize(
    ("k", "damping", "rotor", "samples", "within"),
    [
        (5000.0, 6.0, 0.0, 500, 0.02),
        (800.0, 6.0, 0.0, 500, 0.1),
        (5000.0, 6.0, 0.9, 500, 0.02),
        (5000.0, 3.0, 0.9, 100, 0.02),
    ],
)
def test_compliance_is_that_of_a_simulated_shaft(
    pendulum: Robot, k: float, damping: float, rotor: float, samples: int, within: float
) -> None:
    """Motor led along q(t), link on a shaft of stiffness k and damping: what the motor feels, to first order in 1 / k;
    also where a motion up to 2 Hz comes near the resonance of 4 Hz, where the model counts the motor's inertia among
    the link's, and where samples are few for a resonance of 10 Hz.
    """
    from scipy.integrate import solve_ivp

    structure = Structure.build(pendulum)
    series = FourierSeries(0.5, np.array([0.4]), np.array([[0.5, 0.0, 0.0, 0.3]]), np.array([[0.2, 0.0, -0.4, 0.0]]))
    inertia, weight = 1.3, 10.0 * 0.3 * 9.81
    w = series.frequencies

    def shaft(t: float, x: Array) -> list[float]:
        s, c = np.sin(w * t), np.cos(w * t)
        lead = 0.4 + (series.a / w) @ s - (series.b / w) @ c
        tau = k * (lead[0] - x[0]) + damping * ((series.a @ c + series.b @ s)[0] - x[1])
        return [x[1], (tau + weight * np.cos(x[0])) / inertia]

    settling = 10
    t = np.arange(samples) * series.period / samples
    m = series.motion(t)
    m = Motion(m.q, m.dq, m.ddq, dt=series.period / samples, periodic=True)
    values = structure.true_values()
    rigid = (structure.columns(m) @ values)[:, 0]
    values[structure.base.units.index("kg m^2")] += rotor
    start = [m.q[0, 0] - rigid[0] / k, m.dq[0, 0]]
    later = t + settling * series.period
    found = solve_ivp(shaft, (0.0, (settling + 1) * series.period), start, t_eval=later, rtol=1e-7, atol=1e-9)
    felt = k * (m.q[:, 0] - found.y[0]) + damping * (m.dq[:, 0] - found.y[1])
    resonance = np.sqrt(k / inertia)
    setting = {"resonance": resonance / (2.0 * np.pi), "damping": damping / (2.0 * inertia * resonance)}
    setting["rotor"] = rotor / (inertia + rotor)
    effect = make_effect("joint_elasticity@hinge", pendulum, setting)
    column = effect.columns(m, structure.torques(m, values))[:, 0, 0]
    change = felt - rigid
    compliance = float(column @ change / (column @ column))
    assert compliance == pytest.approx(1e6 / k, rel=within)
    assert np.linalg.norm(change - compliance * column) < 2.5 * within * np.linalg.norm(change)


def test_backlash_bursts_after_the_load_reverses(kuka: Any) -> None:
    """What is told of its signature: above 5 Hz, and near reversals of the load."""
    effect = make_effect("backlash@joint_1", kuka.robot, {"gap": 1.0, "drive": 8.0})
    load = kuka.torques.load[:, 0] - 4.0 * kuka.motion.ddq[:, 0]
    column = effect.columns(kuka.motion, kuka.torques)[:, 0, 0]
    lines = np.abs(np.fft.rfft(column)) ** 2
    high = np.fft.rfftfreq(len(column), kuka.motion.dt) > 5.0
    assert lines[high].sum() > 0.35 * lines.sum()
    reversals = np.flatnonzero(np.sign(load) != np.sign(np.roll(load, 1)))
    assert len(reversals) >= 2
    late = (np.arange(len(load))[:, None] - reversals) * kuka.motion.dt
    near = np.any((late >= -0.03) & (late <= 0.25), axis=1)
    assert np.sum(column[near] ** 2) > 0.9 * np.sum(column**2)


@pytest.mark.parametrize(("contact", "drive"), [(12.0, 8.0), (25.0, 40.0)])
def test_backlash_is_that_of_a_link_between_two_flanks(contact: float, drive: float, pendulum: Robot) -> None:
    """A stiff solver of free flight and contact, the drive a spring and a damper about its path."""
    from scipy.integrate import solve_ivp

    structure = Structure.build(pendulum)
    series = FourierSeries(0.25, np.array([np.pi / 2]), np.array([[0.5, 0.2]]), np.array([[0.3, -0.2]]))
    samples = 600
    t = np.arange(samples) * series.period / samples
    m = series.motion(t)
    m = Motion(m.q, m.dq, m.ddq, dt=series.period / samples, periodic=True)
    values = structure.true_values()
    torques = structure.torques(m, values)
    inertia, gap, ratio, rotor = 1.3, 2e-3, 0.1, 0.26
    link = inertia - rotor
    w, v = 2 * np.pi * contact, 2 * np.pi * drive
    k, d, kp, kd = link * w**2, 2 * ratio * link * w, inertia * v**2, 2 * inertia * v
    path = torques.load[:, 0] - rotor * m.ddq[:, 0]

    def carried(time: float) -> float:
        return float(np.interp(time % series.period, np.append(t, series.period), np.append(path, path[0])))

    def force(z: float, rate: float, e: float, load: float) -> float:
        press, bedding = abs(e - z) - gap / 2, 0.2 * gap
        if press <= 0.0:
            return 0.0
        spring = np.sign(e - z) * k * (press - bedding / 2 if press > bedding else press**2 / (2 * bedding))
        damp = d * min(press / bedding, 1.0)
        return float((spring + damp * ((load - kp * e) / kd - rate)) / (1 + damp / kd))

    def flight(time: float, x: Array) -> list[float]:
        load = carried(time)
        pressed = force(x[0], x[1], x[2], load)
        return [x[1], (pressed - load) / link, (load - pressed - kp * x[2]) / kd]

    start = [-np.sign(path[0]) * gap / 2 - path[0] / k, 0.0, 0.0]
    found = solve_ivp(flight, (0.0, 2 * series.period), start, t_eval=t + series.period, rtol=1e-6, max_step=1e-3)
    felt = np.array([force(*x, load) - load for x, load in zip(found.y.T, path, strict=True)])
    setting = {"gap": 1e3 * gap, "contact": contact, "drive": drive, "damping": ratio, "rotor": rotor / inertia}
    column = make_effect("backlash@hinge", pendulum, setting).columns(m, torques)[:, 0, 0]
    assert np.sum(felt**2) > 0.0
    assert column @ felt / np.linalg.norm(column) / np.linalg.norm(felt) > 0.95
    assert column @ felt / (column @ column) == pytest.approx(1.0, abs=0.1)

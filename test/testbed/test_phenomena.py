"""Each phenomenon against its own equation, written anew in numpy: what it adds at its joint, and nothing elsewhere."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pinocchio
import pytest
from scipy.integrate import solve_ivp

from robot_ident.errors import InputError
from robot_ident.robot import Robot
from robot_ident.signals.motion import Array, Mask, Motion
from robot_ident.testbed.phenomena import PHYSICS, make_physics, plant_physics
from robot_ident.testbed.plant import Plant
from robot_ident.testbed.servo import Servo
from robot_ident.testbed.simulation import SimulationResult, simulate
from robot_ident.testbed.transmissions import motor_inertia

PERIOD, RATE = 4.0, 150.0
FINE = 1500.0
"""A sample at every step [Hz]."""


@dataclass(frozen=True)
class Course:
    """One joint's exact motion, what its gear carries, the drives' torque, and the other joints' motion [N, n]."""

    t: Array
    q: Array
    v: Array
    load: Array
    command: Array
    all: Motion


def robot_torque(robot: Robot, motion: Motion) -> Array:
    """Return Pinocchio's inverse dynamics and the friction of the robot's description."""
    tau = robot.rigid.inverse_dynamics(motion)
    for name, signal in (("viscous", motion.dq), ("coulomb", np.sign(motion.dq))):
        for joint, values in robot.simulation.get(name, {}).items():
            tau[:, robot.joint_index(joint)] += values[name] * signal[:, robot.joint_index(joint)]
    return tau


def rigid_torque(model: pinocchio.Model, motion: Motion) -> Array:
    """Return Pinocchio's inverse dynamics of a model along a motion."""
    data, rows = model.createData(), zip(motion.q, motion.dq, motion.ddq, strict=True)
    return np.array([pinocchio.rnea(model, data, *row) for row in rows])


def added(
    robot: Robot, blend, label: str, periods: int = 1, rate: float = RATE
) -> tuple[SimulationResult, Array, Mask]:
    """Return a simulation without noise, what its drives give beyond the robot's own torque, and rows that move."""
    made = simulate(robot, blend(robot, periods * PERIOD), effects=[label], noise=0.0, sample_rate=rate)
    return made, made.torque - robot_torque(robot, made.exact), np.all(np.abs(made.exact.dq) > 0.02, axis=1)


def sech(x: Array) -> Array:
    return np.asarray(1 / np.cosh(np.minimum(x, 300)))


def other(course: Course, joint: int) -> Array:
    return np.asarray(course.all.dq[:, joint])


FORMULAS: dict[str, Callable[[Course], Array]] = {
    "torque_offset@joint_2:-4": lambda c: np.full(len(c.q), -4.0),
    "viscous_asymmetric@joint_2:3": lambda c: 3 * (np.hypot(c.v, 0.005) - 0.005),
    "stribeck@joint_2:stribeck=20,speed=0.1,exponent=1.3": lambda c: (
        20 * np.sign(c.v) * sech((np.abs(c.v) / 0.1) ** 1.3)
    ),
    "viscous_nonlinear@joint_2:viscous_nonlinear=9,speed=0.1,churning=0": lambda c: (
        9 * np.arcsinh(c.v / 0.1) / np.arcsinh(14.5)
    ),
    "viscous_nonlinear@joint_2:viscous_nonlinear=0,speed=0.1,churning=9": lambda c: 9 * c.v * np.abs(c.v) / 1.45**2,
    "load_friction@joint_2:load_friction=0.1,preload=5": lambda c: np.sign(c.v) * 0.1 * (np.hypot(c.load, 5.0) - 5.0),
    "position_friction@joint_2:position_friction=6,position=0.2,harmonic=2,narrowness=0.7": lambda c: (
        np.sign(c.v) * 6 * np.exp(0.7 * (np.cos(2 * (c.q - 0.2)) - 1))
    ),
    "torque_ripple@joint_2:torque_ripple=2,order=103,phase=0.3,second=0.2": lambda c: (
        2 * (np.sin(103 * c.q + 0.3) + 0.2 * np.sin(206 * c.q))
    ),
    "gravity_spring@joint_2:stiffness=9000,free_length=0.25,length=0.45,lever=0.12": lambda c: np.gradient(
        spring_energy(np.linspace(-3, 3, 60001)), 1e-4
    )[np.round((c.q + 3) / 1e-4).astype(int)],
    "joint_coupling@joint_2:coulomb=5,viscous=3,other=1,inertia=0": lambda c: (
        10 / np.pi * np.arctan(other(c, 0) / 0.004) + 3 * other(c, 0)
    ),
    "end_stop@joint_2:end_stop=60,position=0.1,direction=1": lambda c: (
        60 * np.maximum(c.q - 0.1, 0) * (1 + np.maximum(c.q - 0.1, 0) / 0.6)
    ),
    "torque_saturation@joint_2:0.3": lambda c: (
        c.command * (1 - 1 / np.sqrt(1 + (c.command / 443) ** 2 * (0.7**-2 - 1)))
    ),
    "unknown_bump@joint_2:bump=8,position=0.2,width=0.05": lambda c: 8 * np.exp(-(((c.q - 0.2) / 0.05) ** 2) / 2),
    "unknown_product@joint_2:product=20,other=3": lambda c: 20 * np.sign(c.v) * np.abs(c.v * other(c, 2)) / 1.45**2,
    "unknown_oscillation@joint_2:oscillation=4,frequency=2.5": lambda c: 4 * np.sin(2 * np.pi * 2.5 * c.t),
    "unknown_gear_error@joint_2:gear_error=0.05,lobes=7,phase=0.4": lambda c: -0.05 * np.sin(7 * c.q + 0.4) * c.command,
}


def spring_energy(q: Array) -> Array:
    """Energy of the spring in the table above [J]."""
    return np.asarray(0.5 * 9000 * (np.sqrt(0.45**2 + 0.12**2 - 2 * 0.45 * 0.12 * np.cos(q)) - 0.25) ** 2)


TOLERANCE = {"gravity_spring": 0.2, "end_stop": 0.3, "load_friction": 0.03}
"""Where the formula above is a table, or sharp where rubber is round, or where the plant's load is a step old [Nm]."""


@pytest.mark.parametrize("label", FORMULAS)
def test_it_adds_its_own_torque_and_nothing_else(kuka: Robot, blend, label: str) -> None:
    """Drives' torque less the robot's own inverse dynamics of the exact motion is the phenomenon's equation."""
    made, left, moving = added(kuka, blend, label, 2)
    motion = made.exact
    inertial = kuka.rigid.inverse_dynamics(motion) - kuka.drives.armature * motion.ddq
    course = Course(made.recording.t, motion.q[:, 1], motion.dq[:, 1], inertial[:, 1], made.torque[:, 1], motion)
    expected = FORMULAS[label](course)
    assert np.ptp(expected[moving]) > 1.0 or "offset" in label
    np.testing.assert_allclose(left[moving, 1], expected[moving], atol=TOLERANCE.get(label.partition("@")[0], 1e-6))
    assert np.abs(left[moving][:, [0, 2]]).max() < 1e-9


def test_unknown_field_is_smooth_and_conservative(kuka: Robot, blend) -> None:
    made, left, moving = added(kuka, blend, "unknown_field@joint_2:field=5,seed=4", 2)
    assert 1.0 < np.std(left[moving, 1]) < 12.0
    late = slice(600, 1200)
    again = simulate(kuka, blend(kuka, 2 * PERIOD), effects=["unknown_field@joint_2:field=5,seed=4"], noise=0.0)
    np.testing.assert_array_equal(again.torque[late], made.torque[late])


@pytest.mark.parametrize("tilt", [(0.05, 0.0), (0.0, -0.08), (0.06, 0.03)])
def test_base_tilt_is_gravity_turned(kuka: Robot, blend, tilt: tuple[float, float]) -> None:
    made, left, moving = added(kuka, blend, f"base_tilt:tilt_x={tilt[0]},tilt_y={tilt[1]}")
    model = kuka.rigid.model.copy()
    turned = pinocchio.utils.rotate("x", tilt[0]) @ pinocchio.utils.rotate("y", tilt[1])
    model.gravity.linear = turned.T @ np.array([0.0, 0.0, -9.81])
    change = rigid_torque(model, made.exact) - kuka.rigid.inverse_dynamics(made.exact)
    np.testing.assert_allclose(left[moving], change[moving], atol=1e-9)
    assert np.abs(change).max() > 1.0


@pytest.mark.parametrize(("joint", "free"), [(1, 0.5), (2, 0.1), (2, 1.2)])
def test_external_force_is_the_pull_of_a_hose(kuka: Robot, blend, joint: int, free: float) -> None:
    """By virtual work: Pinocchio's Jacobian of the end times the pull towards the post, nothing where it is slack."""
    post = np.array([0.3, -0.4, 1.1])
    values = f"stiffness=200,free_length={free},x={post[0]},y={post[1]},z={post[2]}"
    made, left, moving = added(kuka, blend, f"external_force@{kuka.joints[joint]}:{values}")
    model = kuka.rigid.model
    frame = model.getFrameId(kuka.end_effector if joint == 2 else kuka.joints[joint + 1])
    data, expected = model.createData(), np.zeros_like(left)
    for row, q in zip(expected, made.exact.q, strict=True):
        jacobian = pinocchio.computeFrameJacobian(model, data, q, frame, pinocchio.LOCAL_WORLD_ALIGNED)[:3]
        away = data.oMf[frame].translation - post
        length = np.linalg.norm(away)
        row[:] = jacobian.T @ (200 * max(length - free, 0.0) * away / length)
    np.testing.assert_allclose(left[moving], expected[moving], atol=1e-8)
    assert np.abs(expected).max() > 1.0
    assert (free > 1.0) == bool(np.any(np.abs(expected[moving]).max(axis=1) < 1e-12))


def test_payload_is_a_mass_at_the_tool(kuka: Robot, blend) -> None:
    made, left, moving = added(kuka, blend, "payload:payload=12,x=0.05,y=0.1,z=-0.02")
    model = kuka.rigid.model.copy()
    frame = model.frames[model.getFrameId(kuka.end_effector)]
    mass = pinocchio.Inertia(12.0, np.array([0.05, 0.1, -0.02]), np.zeros((3, 3)))
    model.appendBodyToJoint(frame.parentJoint, mass, frame.placement)
    change = rigid_torque(model, made.exact) - kuka.rigid.inverse_dynamics(made.exact)
    np.testing.assert_allclose(left[moving], change[moving], atol=1e-8)


def played(path: Array, reach: Array, level: float) -> Array:
    """Return the force of elastic elements that slip at `reach`, along a path, element by element."""
    out = np.zeros(len(path))
    for limit in reach:
        z = 0.0
        for k in range(1, len(path)):
            z = min(max(z + path[k] - path[k - 1], -limit), limit)
            out[k] += level / len(reach) * z / limit
    return out


def test_presliding_is_a_play_of_elements(kuka: Robot, blend) -> None:
    """It replaces Coulomb friction, builds up over a distance, never exceeds its level, and takes energy."""
    made, left, _ = added(kuka, blend, "presliding@joint_2:reach=0.01,coulomb=12", 2, FINE)
    motion = made.exact
    left = left + 6.35 * np.sign(motion.dq) * np.array([0, 1, 0])
    expected = played(motion.q[:, 1], 0.01 * np.array([0.12, 0.3, 0.6, 1.1, 2.0]), 12.0)
    np.testing.assert_allclose(left[:, 1], expected, atol=1e-6)
    assert np.abs(left[:, 1]).max() == pytest.approx(12.0, abs=1e-6)
    steady = slice(6000, 12000)
    assert np.sum(left[steady, 1] * motion.dq[steady, 1]) > 0
    sharp = np.abs(np.diff(left[:, 1])).max()
    assert sharp < 4.0, "no jump of 24 Nm at reversals"


def test_friction_behind_a_play_is_missing_after_reversals(kuka: Robot, blend) -> None:
    """A slide that stays where it is within the clearance, and whose bristles bend once it is touched."""
    made, left, _ = added(kuka, blend, "friction_behind_play@joint_2:level=12,gap=0.05,reach=0.004", 2, FINE)
    expected = np.zeros(len(left))
    for share in (0.12, 0.3, 0.6, 1.1, 2.0):
        apart, reach = 0.0, 0.004 * share
        for k, step in enumerate(np.diff(made.exact.q[:, 1], prepend=made.exact.q[0, 1])):
            apart = min(max(apart + step, -0.025 - reach), 0.025 + reach)
            expected[k] += 12 / 5 * np.sign(apart) * min(max(abs(apart) - 0.025, 0.0) / reach, 1.0)
    moving = np.abs(made.exact.dq[:, 1]) > 0.01
    np.testing.assert_allclose(left[moving, 1], expected[moving], atol=1e-6)
    assert np.mean(expected[6000:] == 0.0) > 0.02


def test_cable_hardens_and_rubs(kuka: Robot, blend) -> None:
    label = "cable@joint_2:cable=9,relaxed=0.1,hardening=0.4,rubbing=2,reach=0.05"
    made, left, _ = added(kuka, blend, label, 2, FINE)
    motion = made.exact
    bent = motion.q[:, 1] - 0.1
    rub = played(motion.q[:, 1], 0.05 * np.array([0.4, 1.0, 1.8]), 2.0)
    moving = np.abs(motion.dq[:, 1]) > 0.01
    np.testing.assert_allclose(left[moving, 1], (9 * bent * (1 + 0.4 * bent**2) + rub)[moving], atol=1e-6)
    steady = slice(6000, 12000)
    assert np.sum(rub[steady] * motion.dq[steady, 1]) > 0


def test_rotor_inertia_adds_to_the_diagonal(kuka: Robot, blend) -> None:
    made, left, moving = added(kuka, blend, "rotor_inertia@joint_3:2")
    np.testing.assert_allclose(left[moving, 2], 2 * made.exact.ddq[moving, 2], atol=1e-9)


@pytest.mark.parametrize("label", ["time_delay@joint_2:0.0083", "time_delay@joint_2:-0.0125", "time_delay:0.01"])
def test_time_delay_shifts_the_recorded_torque_alone(kuka: Robot, blend, label: str) -> None:
    plain = simulate(kuka, blend(kuka, 2 * PERIOD), noise=0.0, sample_rate=1500.0)
    made = simulate(kuka, blend(kuka, 2 * PERIOD), effects=[label], noise=0.0)
    delay = float(label.partition(":")[2])
    np.testing.assert_allclose(made.recording.q, plain.recording.q[::10], atol=1e-9)
    inside = slice(10, -10)
    for j in range(3):
        shift = delay if j == 1 or "@" not in label else 0.0
        expected = np.interp(made.recording.t - shift, plain.recording.t, plain.torque[:, j])
        np.testing.assert_allclose(made.recording.tau[inside, j], expected[inside], atol=1e-6)


def test_eccentric_encoder_misleads_servo_and_recording(kuka: Robot, blend) -> None:
    label = "encoder_eccentricity@joint_2:encoder_eccentricity=0.01,position=0.3,harmonic=1"
    made, left, moving = added(kuka, blend, label, 2)
    q, step = made.exact.q[:, 1], kuka.drives.encoder_step
    wrong = np.arctan2(0.01 * np.sin(q - 0.3), 1 - 0.01 * np.cos(q - 0.3))
    np.testing.assert_allclose(made.recording.q[:, 1], q + wrong, atol=0.51 * step[1])
    rate = np.gradient(wrong, 1 / RATE)
    assert made.recording.dq is not None
    assert np.polyfit(rate, (made.recording.dq - made.exact.dq)[:, 1], 1)[0] == pytest.approx(1.0, abs=0.05)
    wanted = blend(kuka, 2 * PERIOD).reference(made.recording.t).q
    assert np.abs(made.recording.q - wanted)[:, 1].max() < 5e-4
    assert np.abs(q - wanted[:, 1]).max() > 3e-3
    assert np.abs(left[moving]).max() < 1e-9


def test_temperature_drift_as_brute_force_has_it(kuka: Robot, blend) -> None:
    """Two steady states and what lies between them, against every period simulated."""
    label = "temperature_drift@joint_2:temperature_drift=10,time_constant=8"
    reference = blend(kuka, 6 * PERIOD)
    quick = simulate(kuka, reference, steady=(PERIOD, PERIOD, 5), effects=[label], noise=0.0)
    brute = simulate(kuka, reference, effects=[label], noise=0.0)
    rows = len(quick.recording.t)
    difference = (quick.torque - brute.torque[:rows])[:, 1]
    assert np.sqrt(np.mean(difference**2)) < 0.05
    moving = np.abs(brute.exact.dq[:, 1]) > 0.02
    left = (brute.torque - robot_torque(kuka, brute.exact))[:, 1]
    fallen = -10 * (1 - np.exp(-brute.recording.t / 8)) * brute.exact.dq[:, 1]
    np.testing.assert_allclose(left[moving], fallen[moving], atol=1e-6)


def two_masses(robot: Robot, label: str, push: float, shaft) -> tuple[Array, Array]:
    """Return position of motor 1 as the plant has it and as an adaptive solver has it, other joints stuck."""
    stuck = tuple(make_physics(f"coulomb@joint_{k}:900", robot) for k in (2, 3))
    physics = (*stuck, make_physics(label, robot), make_physics("viscous@joint_1:8", robot))
    step = 1 / max(1500.0, PHYSICS[label.partition("@")[0]].step_rate)
    plant = Plant(robot, physics, Servo(*np.zeros((2, robot.n)), np.full(robot.n, np.inf)), step)
    steps = round(0.6 / step)
    t = (np.arange(steps) + 0.5) * step
    tau = np.zeros((steps, 3))
    tau[:, 0] = push * np.sin(30 * t)
    upright = np.zeros(3)
    states = plant.layout.joints(plant.run(plant.rest(upright), np.pad(tau, ((0, 0), (6, 6)))))
    assert not states.v[:, 1:].any()
    mass = pinocchio.crba(robot.rigid.model, robot.rigid.model.createData(), upright)[0, 0]
    rotor = motor_inertia(robot, [0])[0]

    def derivative(time: float, x: Array) -> list[float]:
        carried = shaft(x[0] - x[1], x[2] - x[3])
        return [x[2], x[3], (push * np.sin(30 * time) - carried - 8 * x[2]) / rotor, carried / (mass - rotor)]

    times = np.arange(1, steps + 1) * step
    solution = solve_ivp(derivative, (0, times[-1]), np.zeros(4), "LSODA", times, rtol=1e-9, atol=1e-12, max_step=1e-3)
    return states.q[:, 0], solution.y[0]


def test_an_elastic_joint_is_two_masses_and_a_spring(kuka: Robot) -> None:
    made, expected = two_masses(
        kuka, "joint_elasticity@joint_1:stiffness=80000,damping=60", 200.0, lambda x, v: 80000 * x + 60 * v
    )
    np.testing.assert_allclose(made, expected, atol=1e-4)
    assert np.ptp(expected) > 0.1


def test_backlash_is_two_masses_and_a_gap(kuka: Robot) -> None:
    half, edge = 0.001, 1e-4

    def shaft(x: float, v: float) -> float:
        above, below = np.hypot(x - half, edge), np.hypot(x + half, edge)
        contact = 1 + ((x - half) / above - (x + half) / below) / 2
        return float(80000 * (x + (above - below) / 2) + 200 * contact * v)

    label = "backlash@joint_1:gap=0.002,stiffness=80000,damping=200"
    made, expected = two_masses(kuka, label, 120.0, shaft)
    np.testing.assert_allclose(made, expected, atol=1e-4)
    rigid, _ = two_masses(kuka, "backlash@joint_1:gap=0.00001,stiffness=80000,damping=200", 120.0, shaft)
    assert np.abs(rigid - expected).max() > 5e-4


def test_backlash_bursts_where_the_load_reverses(kuka: Robot, blend) -> None:
    plain = simulate(kuka, blend(kuka, 2 * PERIOD), noise=0.0)
    made = simulate(kuka, blend(kuka, 2 * PERIOD), effects=["backlash@joint_1:gap=0.002"], noise=0.0)
    burst = np.abs(made.torque - plain.torque)[600:, 0]
    inertial = kuka.rigid.inverse_dynamics(plain.exact)[600:, 0]
    near = np.abs(inertial) < 0.15 * np.abs(inertial).max()
    assert burst.max() > 1.0
    assert burst[near].mean() > 2 * burst[~near].mean()
    assert np.abs(made.exact.q - plain.exact.q).max() < 0.004


def test_two_transmissions_of_one_joint_are_refused(kuka: Robot, blend) -> None:
    with pytest.raises(InputError, match="one transmission"):
        simulate(kuka, blend(kuka, 1.0), effects=["backlash@joint_1", "joint_elasticity@joint_1"])


def test_several_at_once_add_up(kuka: Robot, blend) -> None:
    labels = ["torque_offset@joint_2:3", "viscous_asymmetric@joint_2:2", "cable@joint_1", "time_delay@joint_3:0.005"]
    made = simulate(kuka, blend(kuka, PERIOD), effects=labels, noise=0.0)
    left = (made.torque - robot_torque(kuka, made.exact))[:, 1]
    moving = np.abs(made.exact.dq[:, 1]) > 0.02
    expected = 3 + 2 * (np.hypot(made.exact.dq[:, 1], 0.005) - 0.005)
    np.testing.assert_allclose(left[moving], expected[moving], atol=1e-8)
    assert {p.label for p in plant_physics(kuka, labels)} >= {label.partition(":")[0] for label in labels}


@pytest.mark.parametrize("name", sorted(PHYSICS))
def test_what_is_drawn_is_possible_and_runs(kuka: Robot, blend, name: str) -> None:
    """Drawn values lie within bounds, differ between draws, can be written and read, and the plant takes them."""
    kind, rng = PHYSICS[name], np.random.default_rng(0)
    motion = blend(kuka, PERIOD).reference(np.linspace(4, 8, 200))
    drawn = [kind(kuka, None if kind.scope == "robot" else 2, kind.draw(kuka, 2, rng, motion)) for _ in range(4)]
    assert all(make_physics(p.text, kuka).values == p.values for p in drawn)
    made = simulate(kuka, blend(kuka, 1.0), effects=[drawn[0].text], noise=0.0)
    assert np.isfinite(made.recording.tau).all()
    assert drawn[0].scaled(2.0).values != drawn[0].values

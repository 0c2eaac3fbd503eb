"""The plant against solutions known otherwise: a pendulum, its energy, its order of convergence, stick and slip."""

from __future__ import annotations

import numpy as np
import pinocchio
import pytest
from scipy.integrate import solve_ivp

from robot_ident.robot import Robot
from robot_ident.signals.motion import Array, Motion
from robot_ident.testbed.equations import Parts
from robot_ident.testbed.phenomena import make_physics, plant_physics
from robot_ident.testbed.phenomena.phenomenon import Contribution, Instant, Physics, Value
from robot_ident.testbed.plant import Plant, commands
from robot_ident.testbed.servo import Servo

START = np.array([0.1, 0.2, -0.3])
AMPLITUDE, FREQUENCY = np.array([160.0, 200.0, 60.0]), np.array([3.0, 4.0, 5.0])


def open_loop(robot: Robot, step: float, *, friction: bool = True) -> Plant:
    """Return a robot whose drives apply a given torque."""
    physics = plant_physics(robot)
    if not friction:
        physics = tuple(p for p in physics if p.name not in ("viscous", "coulomb"))
    return Plant(robot, physics, Servo(*np.zeros((2, robot.n)), np.full(robot.n, np.inf)), step)


def torques(tau: Array) -> Array:
    """Return commands of drives without gains."""
    return np.pad(tau, ((0, 0), (2 * tau.shape[1], 2 * tau.shape[1])))


def swing(plant: Plant, duration: float, amplitude: Array = AMPLITUDE, start: Array = START) -> tuple[Parts, Array]:
    """Return the states at 0, h, 2 h, ... under sinusoidal torques, and the torques [N, n] in the steps."""
    steps = round(duration / plant.step)
    tau = amplitude * np.sin(np.outer((np.arange(steps) + 0.5) * plant.step, FREQUENCY[: plant.robot.n]))
    rest = plant.rest(start)
    return plant.layout.split(np.vstack([rest, plant.run(rest, torques(tau))])), tau


def mechanical_energy(robot: Robot, q: Array, v: Array) -> float:
    """Return kinetic energy (armature included), potential energy and the spring's energy [J]."""
    model = robot.rigid.model
    data = model.createData()
    mass = pinocchio.crba(model, data, q)
    mass = np.triu(mass) + np.triu(mass, 1).T
    energy = 0.5 * v @ mass @ v + pinocchio.computePotentialEnergy(model, data, q)
    for name, values in robot.simulation.get("gravity_spring", {}).items():
        spring, angle = robot.springs[name], q[robot.joint_index(name)]
        length = np.sqrt(spring.length**2 + spring.lever**2 - 2 * spring.length * spring.lever * np.cos(angle))
        energy += 0.5 * values["stiffness"] * (length - values["free_length"]) ** 2
    return float(energy)


def lost(
    robot: Robot, states: Parts, step: float, effects: tuple[str, ...] = ("viscous", "coulomb", "torque_offset")
) -> float:
    """Return what friction and offsets took [J], velocity being linear over a step."""
    total = 0.0
    for effect in effects:
        by_joint = robot.simulation.get(effect, {})
        for joint, values in by_joint.items():
            j = robot.joint_index(joint)
            v0, v1 = states.v[:-1, j], states.v[1:, j]
            crosses = v0 * v1 < 0
            path = np.where(crosses, (v0**2 + v1**2) / np.where(crosses, np.abs(v0 - v1), 1), np.abs(v0 + v1)) / 2
            if effect == "viscous":
                total += values[effect] * step * np.sum(v0**2 + v0 * v1 + v1**2) / 3
            elif effect == "coulomb":
                total += values[effect] * step * np.sum(path)
            elif effect == "torque_offset":
                total += values[effect] * (states.q[-1, j] - states.q[0, j])
    return total


@pytest.mark.parametrize("friction", [False, True])
def test_work_is_energy_and_loss(kuka_spring: Robot, friction: bool) -> None:
    """Work of the motors = change of energy + friction loss, to an error that falls with the square of the step."""
    errors = []
    for step in (1 / 750, 1 / 1500, 1 / 3000):
        states, tau = swing(open_loop(kuka_spring, step, friction=friction), 2.0)
        work = np.sum(tau * np.diff(states.q, axis=0))
        change = mechanical_energy(kuka_spring, states.q[-1], states.v[-1]) - mechanical_energy(
            kuka_spring, START, np.zeros(3)
        )
        effects = ("viscous", "coulomb", "torque_offset") if friction else ("torque_offset",)
        loss = lost(kuka_spring, states, step, effects)
        errors.append(abs(work - loss - change))
        assert np.abs(tau * np.diff(states.q, axis=0)).sum() > 300.0, "there was work to account for"
    assert errors[1] < 1e-3
    assert errors[0] / errors[1] > 2.8
    assert errors[1] / errors[2] > 2.8


@pytest.mark.parametrize(("friction", "order"), [(False, 1.9), (True, 1.5)])
def test_order_of_convergence(kuka_spring: Robot, friction: bool, order: float) -> None:
    """Second order where motion is smooth, and hardly less with stops, sticking and reversals."""
    exact, _ = swing(open_loop(kuka_spring, 1 / 24000, friction=friction), 2.0)
    turns = np.count_nonzero(np.diff(np.sign(exact.v), axis=0), axis=0)
    assert np.all(turns >= [1, 2, 3])
    steps, errors = np.array([1 / 750, 1 / 1500, 1 / 3000]), []
    for step in steps:
        states, _ = swing(open_loop(kuka_spring, step, friction=friction), 2.0)
        errors.append(max(np.abs(states.q[-1] - exact.q[-1]).max(), np.abs(states.v[-1] - exact.v[-1]).max()))
    slope = np.polyfit(np.log(steps), np.log(errors), 1)[0]
    assert slope > order
    assert errors[1] < 1e-5


def test_free_swing_is_that_of_an_adaptive_solver(kuka: Robot) -> None:
    """Without friction and torque: the three links as a pendulum, against Runge-Kutta 8 on Pinocchio's forward
    dynamics.
    """
    step, start = 1 / 3000, np.array([0.3, 0.6, 0.8])
    plant = open_loop(kuka, step, friction=False)
    states, _ = swing(plant, 3.0, np.zeros(3), start)
    model = kuka.rigid.model
    data = model.createData()

    def derivative(_: float, x: Array) -> Array:
        return np.concatenate([x[3:], pinocchio.aba(model, data, x[:3], x[3:], np.zeros(3))])

    times = np.arange(len(states.q)) * step
    solution = solve_ivp(
        derivative, (0, 3.0), np.concatenate([start, np.zeros(3)]), "DOP853", times, rtol=1e-11, atol=1e-12
    )
    assert np.ptp(states.q[:, 1]) > 0.5
    np.testing.assert_allclose(states.q, solution.y[:3].T, atol=2e-6)


def test_a_joint_below_its_friction_does_not_move(kuka: Robot) -> None:
    """Joint 1 (no gravity, c = 35.12 Nm) stays where it is, to the last bit, and breaks away above c."""
    plant = open_loop(kuka, 1 / 1500)
    upright = np.zeros(3)
    gravity = kuka.rigid.inverse_dynamics(Motion(upright[None], upright[None], upright[None]))[0]
    for share, moves in ((0.999, False), (-0.999, False), (1.001, True), (-1.001, True)):
        tau = np.tile(gravity + [share * 35.12, 0.0, 0.0], (1500, 1))
        states = plant.layout.split(plant.run(plant.rest(upright), torques(tau)))
        assert np.any(states.v[:, 0] != 0) == moves
        if moves:
            assert np.all(states.v[:, 0] * share > 0)
        else:
            assert np.all(states.q == upright)


def test_a_joint_that_runs_out_sticks_without_chatter(kuka: Robot) -> None:
    """Once stopped below its friction a joint has velocity exactly zero in every further step."""
    plant = open_loop(kuka, 1 / 1500)
    push = np.zeros((3000, 3))
    push[:, 0] = np.where(np.arange(3000) < 300, 120.0, 20.0)
    states = plant.layout.split(plant.run(plant.rest(np.zeros(3)), torques(push)))
    v = states.v[:, 0]
    stop = int(np.flatnonzero(v == 0)[0])
    assert 300 < stop < 2500
    assert np.all(v[:stop] > 0)
    assert np.all(v[stop:] == 0)
    assert np.all(states.q[stop:, 0] == states.q[stop, 0])
    # braked by friction and viscous friction alone: b v + c - 20 Nm, solved in closed form
    mass = plant.robot.rigid.model
    inertia = pinocchio.crba(mass, mass.createData(), states.q[stop])[0, 0]
    b, c = 17.76, 35.12 - 20.0
    predicted = inertia / b * np.log(1 + b * v[299] / c)
    assert (stop - 299) / 1500 == pytest.approx(predicted, rel=0.05)


def test_stick_slip_of_a_dragged_joint(kuka: Robot) -> None:
    """A weak position controller that creeps (0.02 rad/s) makes a joint with stribeck friction stick and jump."""
    plant = Plant(
        kuka, plant_physics(kuka, ["stribeck@joint_1:stribeck=20,speed=0.01"]), Servo.make(kuka, "pd", 1.0), 1 / 1500
    )
    t = np.arange(2 * 15000 + 1) / 3000
    q, dq = np.zeros((len(t), 3)), np.zeros((len(t), 3))
    q[:, 0], dq[:, 0] = 0.02 * t, 0.02
    states = plant.layout.split(plant.run(plant.rest(np.zeros(3)), commands(plant.servo, Motion(q, dq, 0 * q))))
    sticks = states.v[:, 0] == 0
    starts = np.count_nonzero(np.diff(sticks.astype(int)) == -1)
    assert 0.3 < np.mean(sticks) < 0.99
    assert 3 <= starts <= 100
    assert np.all(states.v[:, 0] >= 0), "it jumps ahead and sticks, it doesn't shiver"


def test_short_way_gives_what_the_full_problem_gives(kuka: Robot) -> None:
    plant = open_loop(kuka, 1 / 1500)
    states, tau = swing(plant, 1.0)
    state, rows = plant.rest(START), torques(tau)
    for k in range(0, 1500):
        out = np.empty((1, plant.layout.size))
        plant._equations.fold("full", 1)(state, rows[k : k + 1], out)
        state = out[0]
    np.testing.assert_allclose(plant.layout.split(state).v, states.v[-1], atol=1e-11)


def test_arms_of_other_kinds(arm: Robot) -> None:
    """6 and 7 axes and a prismatic joint: order of convergence with friction, stops and reversals; energy is lost,
    never made.
    """
    rng = np.random.default_rng(1)
    start = rng.uniform(-0.5, 0.5, arm.n)
    model = arm.rigid.model
    amplitude = np.abs(pinocchio.computeGeneralizedGravity(model, model.createData(), start)) + 2.5
    results = []
    for step in (1 / 1500, 1 / 3000, 1 / 12000):
        plant = open_loop(arm, step)
        steps = round(0.4 / step)
        t = (np.arange(steps) + 0.5)[:, None] * step
        tau = amplitude * np.sin(10 * t + np.arange(arm.n))
        states = plant.layout.split(plant.run(plant.rest(start), torques(tau)))
        work = float(np.sum(tau * np.diff(np.vstack([start, states.q]), axis=0)))
        change = mechanical_energy(arm, states.q[-1], states.v[-1]) - mechanical_energy(arm, start, np.zeros(arm.n))
        both = Parts(*(np.vstack([0 * s[:1], s]) for s in states))
        results.append((states.q[-1], work - change - lost(arm, both, step)))
        assert work - change > 0
    (q_1, left_1), (q_2, left_2), (q_fine, left_fine) = results
    assert np.ptp(np.sign(both.v), axis=0).min() > 0, "each joint turned or stuck"
    assert np.abs(q_1 - q_fine).max() < 2e-4
    assert np.abs(q_2 - q_fine).max() < 1e-4
    assert abs(left_fine) < 1e-3
    assert abs(left_fine) < abs(left_1)


class Bristle(Physics):
    """A spring that is dragged along and slips (Dahl): dz = (v - |v| z / z0) dt, torque k z."""

    name = "bristle"
    parameters = (Value("stiffness", "Nm/rad", "N/m"), Value("reach", "rad", "m"))
    states = 1

    @classmethod
    def typical(cls, robot: Robot, joint: int) -> dict[str, float]:
        return {"stiffness": 1000.0, "reach": 0.02}

    def contribution(self, x: Instant) -> Contribution:
        return Contribution(torque={self.joint: self.values["stiffness"] * x.state[0]})

    def advance(self, before: Instant, after: Instant, h: float) -> list[object]:
        j, moved = self.joint, (before.v[self.joint] + after.v[self.joint]) / 2 * h
        z = before.state[0]
        share = ((moved**2) ** 0.5) / self.values["reach"]
        return [(z + moved - share * z / 2) / (1 + share / 2) + 0 * after.q[j]]


def test_a_phenomenon_may_have_states_of_its_own(kuka: Robot) -> None:
    """Dragged in one direction the bristle's torque settles at stiffness times reach; below that it holds the joint
    elastically.
    """
    stuck = tuple(make_physics(f"coulomb@joint_{k}:300", kuka) for k in (2, 3))
    plant = Plant(
        kuka,
        (*stuck, Bristle(kuka, 0, {}), make_physics("viscous@joint_1:500", kuka)),
        Servo(*np.zeros((2, kuka.n)), np.full(kuka.n, np.inf)),
        1 / 1500,
    )
    for push, torque in ((60.0, 20.0), (5.0, 5.0), (-5.0, -5.0)):
        tau = np.tile([push, 0.0, 0.0], (6000, 1))
        states = plant.layout.split(plant.run(plant.rest(np.zeros(3)), torques(tau)))
        assert states.own[-1, 0] * 1000.0 == pytest.approx(torque, rel=5e-3)
        assert not states.q[:, 1:].any()
    assert abs(states.v[-1, 0]) < 1e-4

"""The columns of the plain effects at one state, worked out by hand."""

from __future__ import annotations

from math import cos, exp, sin, tanh

import numpy as np
import pytest

from robot_ident.effects import Torques, make_effect
from robot_ident.robot import load_robot
from robot_ident.signals.motion import Motion

Q, V, A = 0.7, -0.4, 1.3  # of joint_2
LOAD, TOTAL = -80.0, 120.0


@pytest.mark.parametrize(
    ("label", "setting", "expected"),
    [
        ("viscous@joint_2", {}, [V]),
        ("coulomb@joint_2", {}, [-1.0]),
        ("torque_offset@joint_2", {}, [1.0]),
        ("viscous_asymmetric@joint_2", {}, [-V]),
        ("stribeck@joint_2", {"vs": 0.2, "d": 2.0}, [-exp(-4.0)]),
        ("stribeck@joint_2", {"vs": 0.1, "d": 0.5}, [-exp(-2.0)]),
        ("viscous_nonlinear@joint_2", {"form": 0.0, "bend": 2.0}, [-0.16]),
        ("viscous_nonlinear@joint_2", {"form": 1.0, "bend": 0.3}, [-tanh(0.4 / 0.3)]),
        ("load_friction@joint_2", {}, [-80.0, -32.0]),
        ("load_friction@joint_2", {"form": 1.0}, [-120.0, -48.0]),
        ("position_friction@joint_2", {"h": 2.0}, [-cos(1.4), -sin(1.4)]),
        ("torque_ripple@joint_2", {"h": 0.5}, [cos(0.5 * 103.235 * Q), sin(0.5 * 103.235 * Q)]),
        ("cable@joint_2", {}, [Q, 1.0]),
        ("torque_saturation@joint_2", {}, [120.0 * 0.120, 120.0 * 0.120**2]),
        ("rotor_inertia@joint_2", {}, [A]),
        ("joint_coupling@joint_2", {"other": 3.0}, [0.5, 1.0, -0.6]),
        ("end_stop@joint_2", {"side": 1.0, "start": 0.5}, [0.2]),
        ("end_stop@joint_2", {"side": 1.0, "start": 0.9}, [0.0]),
        ("end_stop@joint_2", {"side": -1.0, "start": 0.9}, [-0.2]),
        ("end_stop@joint_2", {"side": -1.0, "start": 0.5}, [0.0]),
        ("end_stop@joint_2", {"side": 0.0, "start": -0.5}, [0.2]),
        ("gravity_spring@joint_2", {"ratio": 0.2}, [5.0 * sin(Q) * (1.0 - (1.04 - 0.4 * cos(Q)) ** -0.5)]),
    ],
)
def test_column_is_the_equation(label: str, setting: dict[str, float], expected: list[float]) -> None:
    robot = load_robot()
    motion = Motion(np.array([[0.1, Q, -0.2]]), np.array([[0.2, V, 0.5]]), np.array([[-0.3, A, -0.6]]))
    torques = Torques(np.array([[10.0, LOAD, 5.0]]), np.array([[20.0, TOTAL, 7.0]]))
    columns = make_effect(label, robot, setting).columns(motion, torques)
    np.testing.assert_allclose(columns[0, 1], expected, rtol=1e-9, atol=1e-12)
    assert not np.any(columns[0, [0, 2]])


@pytest.mark.parametrize(
    ("side", "start", "impossible"), [(1, 0.1, True), (1, 0.9, False), (-1, -0.9, False), (0, 0.2, True)]
)
def test_a_stop_does_not_begin_in_the_middle_of_a_range(side: float, start: float, impossible: bool) -> None:
    """joint_2 turns from -1.2 to 1.2 rad; what begins at its middle is a curve over position."""
    stop = make_effect("end_stop@joint_2", load_robot("kuka_ir361")).at({"side": side, "start": start})
    assert stop.contradicts_itself(np.array([100.0]), (), {}) == impossible


def test_no_gear_yields_by_six_degrees() -> None:
    """2000 mrad/kNm under 100 Nm are 0.2 rad, for which a formula of first order does not hold."""
    load = np.full((1, 3), 100.0)
    soft = make_effect("joint_elasticity@joint_2", load_robot("kuka_ir361"))
    assert soft.contradicts_itself(np.array([2000.0]), [(Motion(*np.zeros((3, 1, 3))), Torques(load, load))], {})


def test_a_power_of_speed_keeps_apart_from_viscous_friction() -> None:
    """f |v|^p beside b v tells (p - 1) f alone where p comes near 1."""
    law = make_effect("viscous_nonlinear@joint_1", load_robot("kuka_ir361"))
    down, up, gradual = (
        law.at(of).inner[1] for of in ({"form": 0.0, "bend": 0.6}, {"form": 0.0, "bend": 2.0}, {"form": 1.0})
    )
    assert down.upper == pytest.approx(0.8) and up.lower == pytest.approx(1.25)
    assert gradual.lower < 0.01, "rad/s, within which Coulomb friction sets in"
    back = law.at({"form": 0.0, "bend": 2.0}).at({"form": 1.0, "bend": 0.03}).inner[1]
    assert back == gradual


@pytest.mark.parametrize(
    ("power", "viscous", "falls"), [(1.01, -99.9, True), (2.0, -3.0, True), (2.0, -0.3, False), (2.0, 1.0, False)]
)
def test_friction_that_falls_as_a_joint_begins_to_move_is_stribecks(power: float, viscous: float, falls: bool) -> None:
    law = make_effect("viscous_nonlinear@joint_1", load_robot("kuka_ir361")).at({"form": 0.0, "bend": power})
    v = np.linspace(0.0, 2.0, 200)[:, None] * [1.0, 0.0, 0.0]
    along = [(Motion(v, v, v), Torques(v, v))]
    level = 100.0 if power == 1.01 else 2.0
    curve = viscous * v[:, 0] + level * v[:, 0] ** power
    assert (curve[0] - curve.min() > 0.05 * np.abs(np.diff(curve)).sum()) == falls
    assert law.contradicts_itself(np.array([level]), along, {"viscous@joint_1": viscous}) == falls

"""Ripple of any order, of several lines, with and without a declared gear ratio."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from robot_ident.diagnosis.diagnose import diagnose
from robot_ident.diagnosis.diagnosis import Diagnosis
from robot_ident.estimation.declaration import judge_declaration
from robot_ident.estimation.identify import estimate, identify
from robot_ident.estimation.prediction import measured_for
from robot_ident.model.structure import Structure
from robot_ident.recording.measurement import Processing
from robot_ident.recording.recording import Recording
from robot_ident.robot import load_robot
from robot_ident.signals.order_spectrum import order_gains, order_near, without_lines

RATIO = 103.235
TWO = f"torque_ripple@joint_2:torque_ripple=12,order={3 * RATIO},phase=0.4,second=1.0"
URDF = """<robot name="motor"><link name="base"/><link name="rotor"><inertial><mass value="0.2"/>
<inertia ixx="1e-4" iyy="1e-4" izz="2e-4" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="shaft" type="continuous"><parent link="base"/><child link="rotor"/><axis xyz="0 0 1"/>
<limit effort="2" velocity="50"/></joint></robot>"""


def orders(found: Diagnosis) -> dict[str, float]:
    return {one.label: one.effect.setting.get("h", np.nan) for one in found.missing}


def test_the_fall_by_a_line_is_that_of_least_squares() -> None:
    rng = np.random.default_rng(5)
    angle, signal = np.sort(rng.uniform(0.0, 9.0, 400)), rng.normal(size=400)
    tried = np.linspace(0.3, 40.0, 100)
    gains = order_gains(angle, signal, tried)
    for h, gain in zip(tried, gains, strict=True):
        columns = np.column_stack([np.cos(h * angle), np.sin(h * angle)])
        left = signal - columns @ np.linalg.lstsq(columns, signal, rcond=None)[0]
        assert gain == pytest.approx(signal @ signal - left @ left)


def test_a_line_stands_out_of_noise() -> None:
    rng = np.random.default_rng(6)
    angle = np.cumsum(rng.uniform(0.0, 0.02, 3000))
    signal = 0.4 * np.sin(11.3 * angle) + rng.normal(size=3000)
    tried = np.arange(1.0, 60.0, 0.05)
    gains = order_gains(angle, signal, tried)
    assert tried[np.argmax(gains)] == pytest.approx(11.3, abs=0.06)
    left = without_lines(angle, signal, [float(tried[np.argmax(gains)])])
    assert signal @ signal - left @ left == pytest.approx(np.max(gains))
    assert order_near(angle, signal, 11.25, 0.1) == pytest.approx(11.3, abs=0.01)


@pytest.mark.parametrize("h", [3.0, pytest.param(5.0, marks=pytest.mark.long)])
def test_any_whole_order_of_the_motor_is_found(bench: Any, h: float) -> None:
    found = diagnose(bench.measure((f"torque_ripple@joint_2:torque_ripple=15,order={h * RATIO}",)), bench.structure)
    assert orders(found) == {"torque_ripple@joint_2": h}


@pytest.mark.long
def test_two_lines_are_named_and_added(bench: Any) -> None:
    measured = bench.measure((TWO,))
    assert orders(diagnose(measured, bench.structure)) == {"torque_ripple@joint_2": 3.0, "torque_ripple_2@joint_2": 6.0}
    named = Structure.build(bench.robot, ["torque_ripple@joint_2", "torque_ripple_2@joint_2"])
    model = estimate(measured, named)
    assert [effect.setting["h"] for effect in model.structure.added] == [3.0, 6.0]


@pytest.mark.long
def test_without_a_gear_ratio_the_orders_count_the_joint(bench: Any) -> None:
    plain = replace(bench.robot, drives=replace(bench.robot.drives, gear_ratio=np.ones(3)))
    found = diagnose(bench.measure((TWO,)), Structure.build(plain))
    assert set(orders(found)) == {"torque_ripple@joint_2", "torque_ripple_2@joint_2"}
    np.testing.assert_allclose(sorted(orders(found).values()), [3 * RATIO, 6 * RATIO], rtol=1e-3)


@pytest.fixture(scope="module")
def motor(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """A motor on a bench, 30 s at up to 3 turns a second: inertia, friction, lines at 1, 7 and 14 a turn."""
    folder = tmp_path_factory.mktemp("motor")
    (folder / "motor.urdf").write_text(URDF)
    rng = np.random.default_rng(4)
    t = np.arange(0.0, 30.0, 0.002)
    terms = [(10.0, 0.13, 0.4), (5.0, 0.31, 1.0), (2.0, 0.53, 2.0)]
    q = sum(a * np.sin(2.0 * np.pi * f * t + phase) for a, f, phase in terms)
    dq = sum(2.0 * np.pi * f * a * np.cos(2.0 * np.pi * f * t + phase) for a, f, phase in terms)
    ddq = -sum((2.0 * np.pi * f) ** 2 * a * np.sin(2.0 * np.pi * f * t + phase) for a, f, phase in terms)
    ripple = 0.012 * np.sin(7 * q + 0.3) + 0.008 * np.cos(14 * q) + 0.006 * np.cos(q - 1.0)
    tau = 2e-4 * ddq + 0.02 * np.tanh(dq / 0.02) + 1e-3 * dq + ripple
    rows = (t, (q + rng.normal(size=len(t)) * 2e-4)[:, None], (tau + rng.normal(size=len(t)) * 0.002)[:, None])
    return load_robot(folder / "motor.urdf"), Recording(("shaft",), *rows)


def test_a_low_pass_that_hides_lines_is_said(motor: Any) -> None:
    robot, recording = motor
    model = identify([recording], robot, processing=Processing(low_pass=2.0))
    (note,) = (note for note in diagnose_again(model, recording).notes if "unfiltered torque" in note)
    assert "order 7" in note and "--low-pass" in note


def test_without_a_noise_floor(motor: Any) -> None:
    robot, recording = motor
    found = diagnose_again(identify([recording], robot), recording)
    assert sorted(orders(found).values()) == [1.0, 7.0, 14.0]
    sizes = {one.effect.setting["h"]: np.hypot(*(p.value for p in one.parameters[:2])) for one in found.missing}
    np.testing.assert_allclose([sizes[h] for h in (1.0, 7.0, 14.0)], [0.006, 0.012, 0.008], rtol=0.05)


@pytest.mark.long
def test_an_axis_that_lies_is_diagnosed(motor: Any, tmp_path: Path) -> None:
    """The only joint of a robot, loaded by weight."""
    _, recording = motor
    (tmp_path / "motor.urdf").write_text(URDF.replace('<axis xyz="0 0 1"/>', '<axis xyz="0 1 0"/>'))
    found = diagnose_again(identify([recording], load_robot(tmp_path / "motor.urdf")), recording)
    assert {7.0, 14.0} <= set(orders(found).values())


def test_a_rotor_heavier_than_the_link_is_no_wrong_gain(motor: Any) -> None:
    """A rotor that the URDF lacks makes four times its torque: which of the two it is, no motion of one axis tells."""
    robot, recording = motor
    ddq = np.gradient(np.gradient(recording.q[:, 0], recording.t), recording.t)
    smooth = np.convolve(ddq, np.ones(101) / 101, "same")
    heavier = replace(recording, tau=recording.tau + 6e-4 * smooth[:, None])
    (judged,) = judge_declaration(heavier, robot)
    assert judged.share > 3.0 and judged.verdict == "not_told"
    identify([heavier], robot)


def diagnose_again(model: Any, recording: Recording) -> Diagnosis:
    return diagnose([measured_for(model, recording)], model.structure)

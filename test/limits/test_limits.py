"""The certificate: never more generous than a search on a hundred times denser grid, and hardly less."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from robot_ident.errors import InputError
from robot_ident.limits.certifier import Certifier, Margins, certify
from robot_ident.limits.workspace_distance import FrameKinematics
from robot_ident.robot import Robot
from robot_ident.robot.symbolic import frame_function
from robot_ident.robot.workspace import box, cylinder, half_space
from robot_ident.signals.motion import Array
from robot_ident.trajectories.excitation import Excitation
from robot_ident.trajectories.extremes import certified_minimum, certified_positive
from robot_ident.trajectories.fourier_series import FourierSeries

DENSE = 6400  # the certificate begins with 64 intervals a period
GRID = 3e-3  # what even the dense grid may miss where two alternatives of a rule meet at an angle


@pytest.fixture(scope="module")
def certifier(kuka: Robot) -> Certifier:
    return Certifier(kuka)


def dense_margins(excitation: Excitation, robot: Robot) -> dict[tuple[str, str], float]:
    """Return the smallest distance from every limit on a dense grid, by (quantity, joint or rule)."""
    motion, limits = excitation.series.motion(np.linspace(0.0, excitation.period, DENSE)), robot.limits
    ranges = {
        "position": (motion.q, limits.lower, limits.upper),
        "velocity": (motion.dq, -limits.velocity, limits.velocity),
        "acceleration": (motion.ddq, -limits.acceleration, limits.acceleration),
    }
    out = {}
    for quantity, (values, lower, upper) in ranges.items():
        margin = np.minimum(values - lower, upper - values).min(axis=0)
        out |= {(quantity, joint): float(margin[k]) for k, joint in enumerate(robot.joints)}
    for rule in robot.workspace:
        p = np.array(frame_function(robot, rule.frame)(motion.q.T)).T
        out["workspace", rule.text] = float(rule.margin(p).min())
    return out


def by_name(margins: Margins) -> dict[tuple[str, str], float]:
    return {(item.quantity, item.where): item.margin for item in margins.items if item.quantity != "torque"}


@pytest.mark.parametrize("seed", range(50))
def test_no_dense_search_finds_less_than_is_certified(
    seed: int, kuka: Robot, certifier: Certifier, random_excitation: Callable[..., Excitation]
) -> None:
    excitation = random_excitation(seed, share=0.999)
    certified, found = by_name(certifier.margins(excitation)), dense_margins(excitation, kuka)
    assert certified.keys() == found.keys()
    for key, margin in certified.items():
        assert margin <= found[key] + 1e-12, f"{key}: certified {margin}, found {found[key]}"
        assert margin >= found[key] - GRID, f"{key}: certified {margin} is far below {found[key]}"


@pytest.mark.parametrize("seed", range(5))
def test_every_kind_of_rule_on_slide_and_arm(seed: int, gantry: Robot) -> None:
    rules = (
        half_space("tip", (0.3, 0.2, 1.0), 0.05),
        cylinder("tip", (0.1, 0.0, 0.0), (0.0, 1.0, 0.1), 0.2, -0.5, 0.4),
        box("tip", (-0.9, -0.1, -0.2), (0.7, 0.1, 0.9), inside=True),
        box("tip", (0.3, -0.1, 0.2), (0.4, 0.1, 0.6), inside=False),
        cylinder("tip", (0.1, 0.0, 0.3), (0.2, 1.0, 0.0), 0.5, -0.5, 0.4, inside=True),
        cylinder("tip", (0.0, 0.0, 0.0), (0.0, 0.0, 1.0), 0.8, None, None, inside=True),
        half_space("carriage", (1.0, 0.0, 0.0), -0.45),
    )
    robot, rng = replace(gantry, workspace=rules), np.random.default_rng(seed)
    series = FourierSeries(0.2, rng.uniform(-0.2, 0.2, 2), 0.2 * rng.normal(size=(2, 4)), 0.2 * rng.normal(size=(2, 4)))
    excitation = Excitation("gantry", robot.joints, series, 100.0)
    certified, found = by_name(certify(excitation, robot)), dense_margins(excitation, robot)
    for rule in rules:
        key = ("workspace", rule.text)
        assert found[key] - GRID <= certified[key] <= found[key] + 1e-12, key


def test_the_bound_of_a_frames_acceleration_holds(gantry: Robot, kuka: Robot) -> None:
    rng, h = np.random.default_rng(0), 1e-4
    for robot, frame in ((gantry, "tip"), (kuka, "flange")):
        n = robot.n
        series = FourierSeries(0.3, rng.uniform(-0.5, 0.5, n), rng.normal(size=(n, 3)), rng.normal(size=(n, 3)))
        kinematics, t = FrameKinematics(robot, frame), np.linspace(0.0, series.period, 500)
        p = [kinematics(series.motion(t + shift))[0] for shift in (-h, 0.0, h)]
        acceleration = np.linalg.norm((p[0] - 2 * p[1] + p[2]) / h**2, axis=1)
        motion = series.motion(t)
        travel = np.abs(motion.q).max(axis=0)
        bound = [
            float(kinematics.acceleration_bound(np.abs(motion.dq[k : k + 1]), np.abs(motion.ddq[k]), travel)[0])
            for k in range(len(t))
        ]
        assert np.all(acceleration <= np.array(bound) + 1e-3)


def test_what_breaks_a_limit_is_named_with_joint_value_and_time(
    kuka: Robot, random_excitation: Callable[..., Excitation]
) -> None:
    kept = random_excitation(3, share=0.9)
    faster = replace(kept, series=replace(kept.series, a=kept.series.a * 1.3, b=kept.series.b * 1.3))
    margins = certify(faster, kuka)
    assert not margins.kept
    worst = margins.violations[0]
    state = faster.series.motion(np.array([worst.time]))
    values = {"position": state.q, "velocity": state.dq, "acceleration": state.ddq}[worst.quantity]
    assert values[0, kuka.joint_index(worst.where)] == pytest.approx(worst.value)
    assert worst.where in str(worst)
    assert "breaks" in str(worst)


def test_a_limit_that_is_just_reached_is_not_kept(kuka: Robot) -> None:
    a = np.zeros((3, 1))
    a[0, 0] = 0.9
    excitation = Excitation("kuka_ir361", kuka.joints, FourierSeries(0.1, np.zeros(3), a, np.zeros((3, 1))), 150.0)

    def with_velocity(limit: float) -> Margins:
        velocity = kuka.limits.velocity.copy()
        velocity[0] = limit
        return certify(excitation, replace(kuka, limits=replace(kuka.limits, velocity=velocity)))

    assert not with_velocity(0.9).kept
    assert with_velocity(0.9 + 1e-9).kept


def test_a_rule_that_is_hardly_kept_is_certified(kuka: Robot, random_excitation: Callable[..., Excitation]) -> None:
    excitation = random_excitation(1)

    def height(offset: float) -> Margins:
        return certify(excitation, replace(kuka, workspace=(half_space("flange", (0.0, 0.0, 1.0), offset),)))

    lowest = next(item.value for item in height(0.0).items if item.quantity == "workspace")
    assert height(lowest - 3e-8).kept
    assert not height(lowest + 3e-8).kept


def test_margins_as_json(kuka: Robot, random_excitation: Callable[..., Excitation]) -> None:
    data = json.loads(json.dumps(certify(random_excitation(0), kuka).to_json()))
    assert set(data) == {"kept", "position", "velocity", "acceleration", "workspace", "torque", "notes"}
    assert set(data["velocity"]["joint_2"]) == {"margin", "value", "limit", "time", "unit", "proven"}
    assert [rule["rule"] for rule in data["workspace"]] == [rule.text for rule in kuka.workspace]
    assert data["workspace"][0]["proven"] is True
    assert data["torque"]["joint_1"]["proven"] is True


def test_limits_that_a_robot_does_not_give_are_said_to_be_unknown(
    kuka: Robot, random_excitation: Callable[..., Excitation]
) -> None:
    limits = replace(kuka.limits, acceleration=np.array([3.0, np.inf, 3.0]))
    margins = certify(random_excitation(0), replace(kuka, limits=limits))
    assert margins.unknown == ("acceleration of joint_2",)


def test_a_torque_limit_counts(kuka: Robot, random_excitation: Callable[..., Excitation]) -> None:
    limits = replace(kuka.limits, torque=np.array([393.0, 443.0, 20.0]))
    margins = certify(random_excitation(4), replace(kuka, limits=limits))
    assert [item.where for item in margins.violations if item.quantity == "torque"] == ["joint_3"]


def test_another_robots_trajectory(gantry: Robot, random_excitation: Callable[..., Excitation]) -> None:
    with pytest.raises(InputError, match="another robot"):
        certify(random_excitation(0), gantry)


def test_branch_and_bound_proves_a_minimum() -> None:
    def bound(centres: Array, halves: Array) -> tuple[Array, Array]:
        values = np.cos(7.0 * centres) + 0.1 * centres
        return values, values - 7.1 * halves

    found = certified_minimum(bound, 0.0, 4.0, 1e-6)
    t = np.linspace(0.0, 4.0, 2_000_001)
    least = float(np.min(np.cos(7.0 * t) + 0.1 * t))
    assert found.lower <= least <= found.value + 1e-12
    assert found.value - found.lower <= 1.01e-6
    assert not certified_positive(bound, 0.0, 4.0)

    def shifted(centres: Array, halves: Array) -> tuple[Array, Array]:
        values, lower = bound(centres, halves)
        return values - least + 1e-5, lower - least + 1e-5

    assert certified_positive(shifted, 0.0, 4.0)

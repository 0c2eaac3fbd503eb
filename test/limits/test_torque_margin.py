"""Ranges by interval arithmetic hold every value, and so do the certified torques."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

from robot_ident.limits.certifier import Certifier, certify
from robot_ident.limits.interval import RangeFunction, Unbounded
from robot_ident.limits.torque_bound import TorqueModel, TorqueRange
from robot_ident.planning.blends import Playback
from robot_ident.planning.validation_motion import validation_motion
from robot_ident.robot import Robot, load_robot
from robot_ident.trajectories.excitation import Excitation, Piece


def expressions(x: ca.SX) -> list[ca.SX]:
    a, b, c = x[0], x[1], x[2]
    return [
        ca.sin(a) * ca.cos(b) - c,
        ca.sin(3 * a + b) ** 2 + a * a * b,
        ca.tanh(a) + ca.exp(-b) * ca.fabs(c),
        ca.sign(a) * b + ca.fmax(a, c) - ca.fmin(b, 2 * c),
        ca.sqrt(a * a + 1.0) / (b * b + 0.5) + ca.atan(c),
        (a + b) ** 3 - 1 / (c * c + 2),
    ]


@pytest.mark.parametrize("width", [1e-3, 0.3, 4.0])
def test_ranges_hold_every_value(width: float) -> None:
    x = ca.SX.sym("x", 3)
    function = ca.Function("f", [x], [ca.vertcat(*expressions(x))])
    rng, boxes = np.random.default_rng(0), 200
    low = rng.uniform(-3.0, 3.0, (boxes, 3))
    high = low + width * rng.uniform(0.0, 1.0, (boxes, 3))
    ((lower, upper),) = RangeFunction(function)([(low, high)])
    for _ in range(200):
        values = np.array(function((low + rng.uniform(size=low.shape) * (high - low)).T)).T
        assert np.all((lower <= values) & (values <= upper))
    if width < 0.01:
        smooth = [0, 1, 2, 4, 5]
        assert np.all((upper - lower)[:, smooth] < 300 * width), "narrow boxes have narrow ranges"


def test_what_has_no_range_is_said() -> None:
    x = ca.SX.sym("x")
    with pytest.raises(Unbounded):
        RangeFunction(ca.Function("f", [x], [ca.acos(x)]))
    with pytest.raises(Unbounded):
        RangeFunction(ca.Function("f", [x], [1 / x]))([(np.array([[-1.0]]), np.array([[1.0]]))])


@pytest.mark.parametrize("name", ["kuka_ir361", "kuka_ir361_spring"])
@pytest.mark.parametrize("seed", range(3))
def test_no_dense_search_finds_more_torque_than_is_certified(
    name: str, seed: int, random_excitation: Callable[..., Excitation]
) -> None:
    robot, excitation = load_robot(name), random_excitation(seed)
    items = [item for item in certify(excitation, robot).items if item.quantity == "torque"]
    motion = excitation.series.motion(np.linspace(0.0, excitation.period, 20_000))
    most = np.abs(TorqueModel(robot).torque(motion)).max(axis=0)
    for item, found in zip(items, most, strict=True):
        assert item.proven
        assert item.margin <= item.limit - found, "never more generous"
        assert item.margin >= item.limit - found - 0.003 * item.limit, "hardly less"


def test_jumps_of_friction_and_acceleration_are_enclosed(kuka: Robot) -> None:
    """A motion at full acceleration with full stops: torque jumps with both."""
    motion = validation_motion(kuka, seed=1, points=4)
    items = [item for item in certify(motion, kuka).items if item.quantity == "torque"]
    t = np.linspace(0.0, motion.duration, 40_000)
    most = np.abs(TorqueModel(kuka).torque(motion.reference(t))).max(axis=0)
    for item, found in zip(items, most, strict=True):
        assert item.proven
        assert item.limit - found - 0.004 * item.limit <= item.margin <= item.limit - found


def test_the_blends_are_proven_too(kuka: Robot, random_excitation: Callable[..., Excitation]) -> None:
    playback = Playback(random_excitation(0, share=0.8), kuka, 1)
    parts = Certifier(kuka).parts(playback)
    assert set(parts) == {"periodic", "blend_in", "blend_out"}
    t = np.linspace(0.0, playback.duration, 40_000)
    motion, model = playback.reference(t), TorqueModel(kuka)
    ends = {"blend_in": t < playback.transient, "blend_out": t > playback.steady_end}
    for name, rows in ends.items():
        tau = model.torque(type(motion)(motion.q[rows], motion.dq[rows], motion.ddq[rows]))
        limits = kuka.limits
        dense = {
            "position": np.minimum(motion.q[rows] - limits.lower, limits.upper - motion.q[rows]).min(axis=0),
            "velocity": (limits.velocity - np.abs(motion.dq[rows])).min(axis=0),
            "acceleration": (limits.acceleration - np.abs(motion.ddq[rows])).min(axis=0),
            "torque": (limits.torque - np.abs(tau)).min(axis=0),
        }
        for item in parts[name].items:
            if item.quantity in dense:
                assert item.proven
                found = dense[item.quantity][kuka.joint_index(item.where)]
                assert found - 0.004 * abs(item.limit) <= item.margin <= found + 1e-6


def test_a_torque_limit_is_kept_or_broken_exactly(kuka: Robot, random_excitation: Callable[..., Excitation]) -> None:
    excitation = random_excitation(4)
    series = excitation.series
    model = TorqueModel(kuka)
    most = np.abs(model.torque(series.motion(np.linspace(0.0, series.period, 40_000)))).max(axis=0)
    piece = Piece(0.0, series.period, series.motion, series.extremes(), series.jerk_bound())
    assert TorqueRange(model, 1.001 * most).keeps(piece)
    assert not TorqueRange(model, 0.999 * most).keeps(piece)


def test_without_a_bound_of_the_jerk_it_is_said_to_be_from_samples(
    kuka: Robot, random_excitation: Callable[..., Excitation]
) -> None:
    series = random_excitation(0).series
    piece = Piece(0.0, series.period, series.motion, series.extremes(), series.jerk_bound())
    torque = TorqueRange(TorqueModel(kuka), kuka.limits.torque)
    assert torque.extreme(piece).proven
    assert not torque.extreme(replace(piece, jerk=None)).proven


def test_what_keeps_a_limit_by_less_than_the_tolerance_has_a_margin(
    kuka: Robot, random_excitation: Callable[..., Excitation]
) -> None:
    series = random_excitation(4).series
    model = TorqueModel(kuka)
    most = np.abs(model.torque(series.motion(np.linspace(0.0, series.period, 40_000)))).max(axis=0)
    piece = Piece(0.0, series.period, series.motion, series.extremes(), series.jerk_bound())
    torque = TorqueRange(model, 1.0005 * most)
    found = torque.extreme(piece)
    assert torque.keeps(piece) and found.proven
    assert np.all(found.bound < 1.0005 * most), "certificate and margins agree"
    assert np.all(found.bound >= most), "and the bound is one"
    assert np.all(TorqueRange(model, 0.9995 * most).extreme(piece).bound > 0.9995 * most)

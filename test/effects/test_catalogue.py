"""What every effect of the catalogue promises, measured; a new one is covered by standing in it."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np
import pytest

from robot_ident.effects import CATALOGUE, Effect, Signals, candidates_of, make_effect
from robot_ident.effects.check import problems
from robot_ident.errors import InputError
from robot_ident.model.expressions import columns_function
from robot_ident.model.structure import Structure
from robot_ident.robot import load_robot
from robot_ident.signals.motion import Array, Motion

NAMES = sorted(CATALOGUE)
ARMS = ("kuka", "six_axes", "slide")
ISSUED = """viscous coulomb torque_offset viscous_asymmetric stribeck viscous_nonlinear presliding load_friction
friction_behind_play
position_friction torque_ripple
torque_ripple_2 torque_ripple_3 backlash joint_elasticity cable gravity_spring base_tilt torque_saturation time_delay
encoder_eccentricity rotor_inertia payload joint_coupling temperature_drift end_stop wrist_coupling
external_force
effort_gain torque_scale effort_filter link_length stamp_jitter mirrored_joint exchanged_joints"""


def test_names_stay_as_users_write_them() -> None:
    assert set(ISSUED.split()) == set(NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_declarations_are_whole(name: str) -> None:
    effect = CATALOGUE[name]
    assert problems(effect) == []
    assert effect.name == name
    assert effect.__name__ == "".join(word.capitalize() for word in name.split("_"))
    assert sys.modules[effect.__module__].__file__.endswith(f"/{name}.py")
    assert effect.experiment and effect.magnitude and effect.signature
    assert set(effect.confused_with) <= set(NAMES) - {name}
    assert {*effect.contains, effect.more_than or name} <= set(NAMES)
    assert effect.regression or effect.evidence


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("arm", ARMS)
def test_columns_are_finite_for_every_setting(name: str, arm: str, case: Callable[[str], Any]) -> None:
    at = case(arm)
    for effect in at.effects(name):
        settings = effect.settings(at.motion)
        assert len(settings) <= (30 if len(effect.inner) > 1 else 12)
        for setting in settings:
            for inner in effect.inner:
                assert inner.lower <= setting[inner.name] <= inner.upper
            columns = effect.at(setting).columns(at.motion, at.torques)
            assert columns.shape == (at.motion.samples, at.robot.n, len(effect.coefficients))
            assert np.isfinite(columns).all()
            assert effect.hidden_in(at.motion) or np.any(columns) or effect.scales_links
        assert len(effect.parameter_names()) == len(effect.parameter_units()) == len(effect.coefficients)
        assert len(effect.inner_names()) == len(effect.inner_units()) == len(effect.inner)


def shares(column: Array) -> tuple[float, float]:
    """Return the shares of a column's energy that are odd and even in time."""
    odd, even = (column - column[::-1]) / 2, (column + column[::-1]) / 2
    total = np.sum(column**2)
    return float(np.sum(odd**2) / total), float(np.sum(even**2) / total)


def in_time(effect: Effect) -> Effect:
    """Return the effect with a drift so slow that a motion and its reverse are alike, a gear that rings with it."""
    setting = {"temperature_drift": {"T0": 450.0}, "joint_elasticity": {"resonance": 4.0}}
    return effect.at(setting.get(effect.name, {}))


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("arm", ["kuka", "six_axes"])
def test_symmetry_in_time_is_the_declared_one(name: str, arm: str, case: Callable[[str], Any]) -> None:
    at, both = case(arm), dict.fromkeys(range(len(CATALOGUE[name].coefficients)), 0.0)
    for effect in (in_time(effect) for effect in at.effects(name)):
        motion = at.mirrored
        if effect.hidden_in(motion):
            motion = Motion(motion.q, motion.dq, motion.ddq, dt=motion.dt)
        columns = effect.columns(motion, at.mirrored_torques)
        for k, coefficient in enumerate(effect.coefficients):
            column = columns[:, :, k]
            if not np.abs(column).max() > 1e-12:
                continue  # no load on this joint, no gravity along this axis
            odd, even = shares(column)
            both[k] = max(both[k], min(odd, even))
            symmetry = coefficient.symmetry or effect.symmetry
            assert symmetry != "dissipative" or even < 1e-4, (effect.label, coefficient.name)
            assert symmetry != "conservative" or odd < 1e-4, (effect.label, coefficient.name)
    if CATALOGUE[name].symmetry in ("memory", "mixed"):
        assert min(both.values()) > 1e-3, "both parts on some joint (a load that never reverses crosses no gap)"


@pytest.mark.parametrize("name", [name for name in NAMES if CATALOGUE[name].symbolic])
@pytest.mark.parametrize("arm", ["kuka", "slide"])
def test_expressions_are_the_columns(name: str, arm: str, case: Callable[[str], Any]) -> None:
    at = case(arm)
    motion, n = at.motion[::97], at.robot.n
    torques = at.structure.torques(motion, at.values)
    numbers = (motion.q, motion.dq, motion.ddq, torques.load, torques.total)
    symbols = [ca.SX.sym(f"x{k}", n) for k in range(5)]
    m = SimpleNamespace(sin=ca.sin, cos=ca.cos, exp=ca.exp, sqrt=ca.sqrt, sign=ca.sign, fabs=ca.fabs, tanh=ca.tanh)
    for effect in at.effects(name):
        expected = effect.columns(motion, torques)
        for k, term in enumerate(effect.terms(Signals(*(ca.vertsplit(s) for s in symbols)), m)):
            torque = ca.SX(n, 1)
            for joint, value in term.items():
                torque[joint] = value
            found = ca.Function("f", symbols, [torque]).map(motion.samples)(*(x.T for x in numbers))
            np.testing.assert_allclose(np.array(found).T, expected[:, :, k], atol=1e-9, rtol=1e-9)


def test_excitations_can_be_designed_for_effects_of_the_load(kuka: Any) -> None:
    structure = Structure.build(kuka.robot, ["stribeck@joint_1", "load_friction@joint_2", "torque_saturation@joint_3"])
    values = np.concatenate([kuka.values, [5.0, 0.05, 0.01, 0.1, 0.1]])
    motion = kuka.motion[::100]
    phi = columns_function(structure, values=values)
    numeric = structure.columns(motion, values)
    for k in range(motion.samples):
        np.testing.assert_allclose(np.array(phi(motion.q[k], motion.dq[k], motion.ddq[k])), numeric[k], atol=1e-9)
    with pytest.raises(InputError, match="load_friction@joint_2 depend on the model's torque"):
        columns_function(structure)


def test_candidates_are_what_a_column_can_show(kuka: Any) -> None:
    labels = [effect.label for effect in candidates_of(kuka.structure)]
    assert len(labels) == len(set(labels))
    assert {"stribeck@joint_2", "time_delay", "time_delay@joint_3", "base_tilt", "rotor_inertia@joint_3"} <= set(labels)
    assert not {
        "rotor_inertia@joint_1",
        "payload",
        "backlash@joint_1",
        "viscous@joint_1",
        "gravity_spring@joint_1",
    } & set(labels)


def test_a_model_with_an_offset_takes_the_cable_without_its_own() -> None:
    robot = load_robot("kuka_ir361_spring")
    structure = Structure.build(robot)
    cable = next(effect for effect in candidates_of(structure) if effect.label == "cable@joint_1")
    assert [c.name for c in cable.coefficients] == ["stiffness"]
    with_cable = Structure.build(robot, ["cable@joint_1"])
    assert with_cable.names[-1] == "cable@joint_1"
    motion = Motion(*np.random.default_rng(1).uniform(-1, 1, (3, 300, 3)))
    assert np.linalg.matrix_rank(with_cable.columns(motion).reshape(900, -1)) == len(with_cable.names)
    plain = Structure.build(load_robot(), ["cable@joint_1"])
    assert plain.names[-2:] == ("cable.stiffness@joint_1", "cable.offset@joint_1")
    assert "torque_offset@joint_1" not in [effect.label for effect in candidates_of(plain)]
    with pytest.raises(InputError, match="merges with cable@joint_1"):
        Structure.build(load_robot(), ["cable@joint_1", "torque_offset@joint_1"])


@pytest.mark.parametrize("joint", ["joint_2", "joint_3"])
def test_a_spring_of_unknown_geometry_has_columns_of_its_own(joint: str, kuka: Any) -> None:
    """Axis 2 stands still across gravity, so that sin q2 merges with it; sin q3 alone does not."""
    structure = Structure.build(kuka.robot, [f"gravity_spring@{joint}"])
    spring = structure.effects[-1]
    assert [c.name for c in spring.coefficients] == (["bend"] if joint == "joint_2" else ["net", "bend"])
    motion = Motion(*np.random.default_rng(1).uniform(-1, 1, (3, 300, 3)))
    scaled = structure.columns(motion).reshape(900, -1)
    assert np.linalg.matrix_rank(scaled / np.linalg.norm(scaled, axis=0), tol=1e-6) == len(structure.names)
    known = Structure.build(load_robot("kuka_ir361_spring")).effects
    (of_yaml,) = (effect for effect in known if effect.name == "gravity_spring")
    ratio = Structure.build(kuka.robot, ["gravity_spring@joint_2"]).effects[-1].at({"ratio": 0.1 / 0.488})
    k_l0, lever, length = 3219.2, 0.100, 0.488
    linear = k_l0 * lever * np.sin(motion.q[:, 1])
    bend = k_l0 * lever**2 / length * ratio.columns(motion)[:, 1, 0]
    np.testing.assert_allclose(bend - linear, 3.2192 * of_yaml.columns(motion)[:, 1, 0])


@pytest.mark.parametrize(
    ("label", "words"),
    [
        ("payload", "invisible in one run"),
        ("payload@joint_3", "whole robot"),
        ("stribeck", "needs its joint"),
        ("base_tilt@joint_1", "whole robot"),
        ("time_delay@joint_9", "no joint 'joint_9'"),
        ("wrist_coupling@joint_1", "no joint before it"),
        ("gravity_spring@joint_1", "gravity does not load"),
    ],
)
def test_what_a_robot_can_not_have_is_one_line(label: str, words: str, kuka: Any) -> None:
    with pytest.raises(InputError, match=words):
        make_effect(label, kuka.robot)


def test_what_is_stretched_over_a_position_needs_its_limits(kuka: Any) -> None:
    """A shaft that turns without end would wind a cable up, and no stop is reached."""
    limits = replace(kuka.robot.limits, lower=np.array([-np.inf, -1.2, -1.2]), upper=np.array([np.inf, 1.2, 1.2]))
    endless = Structure.build(replace(kuka.robot, limits=limits))
    tried = {effect.label for effect in candidates_of(endless)}
    assert not tried & {"cable@joint_1", "end_stop@joint_1"} and {"cable@joint_2", "end_stop@joint_2"} <= tried
    with pytest.raises(InputError, match="cable@joint_1"):
        make_effect("cable@joint_1", endless.robot)


def test_orders_of_a_ripple_count_the_motor_where_its_gear_is_declared(kuka: Any, slide: Any) -> None:
    ripple = make_effect("torque_ripple@joint_2", kuka.robot)
    assert ripple.geared and [setting["h"] for setting in ripple.settings()] == [0.5, 1.0, 2.0, 4.0]
    assert np.all(np.diff(ripple.orders(kuka.motion, 75.0)) == 1.0)
    of_screw = make_effect("torque_ripple@slide", slide.robot)
    assert not of_screw.geared and not of_screw.settings()
    orders = of_screw.orders(slide.motion, 30.0)
    travel = np.ptp(slide.motion.q)
    assert orders[0] * travel == pytest.approx(6.0 * np.pi) and np.ptp(np.diff(orders)) < 1e-9


def test_effects_of_one_joint_and_of_all(kuka: Any) -> None:
    torques = kuka.torques
    whole, one = make_effect("time_delay", kuka.robot), make_effect("time_delay@joint_2", kuka.robot)
    assert (whole.label, whole.place) == ("time_delay", None)
    assert (one.label, one.place) == ("time_delay@joint_2", "joint_2")
    together, alone = whole.columns(kuka.motion, torques), one.columns(kuka.motion, torques)
    assert not np.any(alone[:, [0, 2]])
    np.testing.assert_array_equal(together[:, 1], alone[:, 1])
    assert np.all(np.any(together, axis=(0, 2)))


def test_effects_with_a_past_refuse_single_instants(kuka: Any) -> None:
    for name in (name for name in NAMES if CATALOGUE[name].needs_time):
        effect = next(kuka.effects(name))
        with pytest.raises(InputError, match="sampled evenly"):
            effect.columns(kuka.motion[::3], kuka.torques)


def test_an_inner_parameter_that_is_not_there(kuka: Any) -> None:
    with pytest.raises(InputError, match="no inner parameter 'v'.*did you mean 'vs'"):
        make_effect("stribeck@joint_1", kuka.robot, {"v": 0.1})

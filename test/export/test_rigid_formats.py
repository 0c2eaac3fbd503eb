"""URDF and MJCF hold the model: Pinocchio, which knows nothing of it, computes the same torque from the file."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pinocchio
import pytest

from robot_ident.errors import InputError
from robot_ident.estimation.identify import identify
from robot_ident.estimation.physical_consistency import least_eigenvalues
from robot_ident.export.exported import Dynamics, torque_of
from robot_ident.export.inertias import FullInertias
from robot_ident.export.to_mjcf import to_mjcf
from robot_ident.export.to_urdf import to_urdf
from robot_ident.model.model import Model
from robot_ident.robot import Robot, load_robot
from robot_ident.robot.urdf import parse_urdf
from robot_ident.signals.motion import Motion

Make = Callable[..., Model]


def states(n: int) -> Motion:
    q, v, a = np.random.default_rng(0).uniform(-1.0, 1.0, (3, 40, n))
    return Motion(q, v, 4.0 * a)


def torque(text: str, motion: Motion, *, xml: bool = False) -> tuple[Any, np.ndarray]:
    """Return Pinocchio's model of a file, and its torque with the file's own damping and friction."""
    if xml:
        with tempfile.NamedTemporaryFile("w", suffix=".xml") as file:
            file.write(text)
            file.flush()
            body = pinocchio.buildModelFromMJCF(file.name)
    else:
        body = parse_urdf(text, Path("exported.urdf"))
    data = body.createData()
    rigid = [pinocchio.rnea(body, data, *x) for x in zip(motion.q, motion.dq, motion.ddq, strict=True)]
    dry = body.upperDryFrictionLimit if hasattr(body, "upperDryFrictionLimit") else body.friction
    return body, np.array(rigid) + body.damping * motion.dq + dry * np.sign(motion.dq)


def bodies_of(body: Any) -> np.ndarray:
    return np.concatenate([one.toDynamicParameters() for one in list(body.inertias)[1:]])


def test_identified_kuka_as_urdf_needs_no_armature(arm: Any) -> None:
    model = identify([arm.record(0)], arm.robot)
    made = to_urdf(Dynamics.of(model))
    body, tau = torque(made.files[""], states(3))
    assert not np.any(body.armature)
    assert not any("rotor inertia" in note for note in made.notes)
    np.testing.assert_allclose(tau, model.predict(states(3)), atol=1e-9)
    assert least_eigenvalues(bodies_of(body)).min() > 0.0


def test_links_on_the_border_of_the_possible_may_need_a_rotor(arm: Any) -> None:
    """Link 3 is as flat as p15 = p11 makes it; what it then has no room for, rotor 2 has to hold, as the note says."""
    model = identify([arm.record(3)], arm.robot, physical=True)
    dynamics = Dynamics.of(model)
    made = to_urdf(dynamics)
    body, tau = torque(made.files[""], states(3))
    rotors = dynamics.inertias.without_rotors(model.structure).rotors
    assert 0.0 < rotors[1] < dynamics.inertias.rotors[1]
    assert any(f"joint_2 {rotors[1]:.6g} kg m^2 are not in the file" in note for note in made.notes)
    np.testing.assert_allclose(tau + rotors * states(3).ddq, model.predict(states(3)), atol=1e-9)
    lost = torque_of(model, made, states(3))["rotor_inertia@joint_2"]
    np.testing.assert_allclose(lost, np.sqrt(np.mean((tau - model.predict(states(3))) ** 2, axis=0)), atol=1e-9)
    assert least_eigenvalues(bodies_of(body)).min() > 0.0


def test_identified_kuka_as_mjcf(arm: Any) -> None:
    model = identify([arm.record(3)], arm.robot, physical=True)
    body, tau = torque(to_mjcf(Dynamics.of(model)).files[""], states(3), xml=True)
    np.testing.assert_allclose(tau, model.predict(states(3)), atol=1e-9)
    assert body.armature[0] > 0.0
    np.testing.assert_allclose(body.upperPositionLimit, [1.6, 1.2, 1.2])
    assert list(body.names)[1:] == list(arm.robot.joints)


def test_locked_joints_and_bolted_links(gantry: Robot, make: Make) -> None:
    """What moves with a link counts with it; its own inertia is then gone from the file."""
    model = make(gantry)
    made = to_urdf(Dynamics.of(model))
    body, tau = torque(made.files[""], states(2))
    np.testing.assert_allclose(tau, model.predict(states(2)), atol=1e-9)
    tree = ElementTree.fromstring(made.files[""])
    kinds = {joint.get("name"): joint.get("type") for joint in tree.findall("joint")}
    assert kinds == {"slide": "prismatic", "bolt": "fixed", "hinge": "continuous", "wrist": "fixed", "finger": "fixed"}
    heavy = {link.get("name") for link in tree.findall("link") if link.find("inertial") is not None}
    assert heavy == {"rail", "carriage", "arm"}
    assert tree.find("link[@name='carriage']/visual/geometry/mesh") is not None
    assert tree.find("link[@name='carriage']/collision/geometry/box") is not None
    assert any("wrist at 0.7, finger at 0.05" in note for note in made.notes)
    assert tree.find("joint[@name='finger']/dynamics") is None
    data, place = body.createData(), gantry.rigid.frame_position(np.zeros((1, 2)), "tip")[0]
    pinocchio.forwardKinematics(body, data, np.zeros(2))
    pinocchio.updateFramePlacements(body, data)
    np.testing.assert_allclose(data.oMf[body.getFrameId("tip")].translation, place, atol=1e-12)


def test_mjcf_of_slides_and_skew_axes(gantry: Robot, make: Make) -> None:
    model = make(gantry)
    _, tau = torque(to_mjcf(Dynamics.of(model)).files[""], states(2), xml=True)
    np.testing.assert_allclose(tau, model.predict(states(2)), atol=1e-9)


@pytest.mark.parametrize("name", ["ur5_robot", "z1", "kinova"])
def test_arms_of_others(robots_folder: Path, make: Make, name: str) -> None:
    paths = {path.stem: path for path in robots_folder.glob("*/urdf/*.urdf")} | {
        path.stem: path for path in robots_folder.glob("*/*.urdf")
    }
    if name not in paths:
        pytest.skip(f"{name} is not among the robots")
    robot = load_robot(paths[name])
    model = make(robot)
    body, tau = torque(to_urdf(Dynamics.of(model)).files[""], states(robot.n))
    assert list(body.names)[1:] == list(robot.joints)
    scale = np.abs(tau).max()
    np.testing.assert_allclose(tau, model.predict(states(robot.n)), atol=1e-9 * max(scale, 1.0))


def test_a_rotor_that_no_link_can_hold_is_said(arm: Any, make: Make) -> None:
    """Rotor 3 couples with nothing: its own column, which URDF can't carry and MJCF can."""
    values = make(arm.robot, ["rotor_inertia@joint_3"]).values.copy()
    values[-1] = 2.5
    model = make(arm.robot, ["rotor_inertia@joint_3"], values)
    made = to_urdf(Dynamics.of(model))
    assert made.left == ("rotor_inertia@joint_3",)
    assert any("joint_3 2.5 kg m^2" in note for note in made.notes)
    _, tau = torque(to_mjcf(Dynamics.of(model)).files[""], states(3), xml=True)
    np.testing.assert_allclose(tau, model.predict(states(3)), atol=1e-9)


def test_effects_that_no_format_holds_are_listed(make: Make) -> None:
    model = make(load_robot("kuka_ir361_spring"))
    made = to_urdf(Dynamics.of(model))
    assert made.left == ("gravity_spring@joint_2", *(f"torque_offset@joint_{k}" for k in (1, 2, 3)))
    _, tau = torque(made.files[""], states(3))
    lacking = model.structure.columns(states(3))[:, :, -4:] @ model.linear[-4:]
    np.testing.assert_allclose(tau, model.predict(states(3)) - lacking, atol=1e-9)


def test_impossible_parameters_are_refused_with_the_inequality(arm: Any, make: Make) -> None:
    values = make(arm.robot).values.copy()
    values[10], values[14] = 8.21, 7.63  # Table I as printed
    with pytest.raises(InputError, match=r"p15 >= p11 does not hold: 7\.63 < 8\.21.*--physical"):
        Dynamics.of(make(arm.robot, (), values))


def test_negative_friction_is_refused(arm: Any, make: Make) -> None:
    values = make(arm.robot).values.copy()
    values[16] = -3.0
    with pytest.raises(InputError, match="viscous@joint_2 = -3 is negative"):
        Dynamics.of(make(arm.robot, (), values))


def test_without_rotors_only_what_no_torque_tells_changes(arm: Any, make: Make) -> None:
    model = make(arm.robot)
    full = FullInertias.of(model)
    bare = full.without_rotors(model.structure)
    assert full.rotors[:2].min() > 1.0
    assert not bare.rotors.any()
    base = model.structure.base
    before, after = (base.regrouping @ np.concatenate([one.links, one.rotors]) for one in (full, bare))
    np.testing.assert_allclose(after, before, atol=1e-12)
    np.testing.assert_allclose(after, model.linear[:15], atol=1e-12)


def test_a_wall_mounted_robot_says_so(gantry: Robot, make: Make) -> None:
    body = gantry.rigid.model.copy()
    body.gravity.linear = np.array([0.0, 9.81, 0.0])
    model = make(replace(gantry, rigid=replace(gantry.rigid, model=body)))
    assert any(
        "gravity [0.0, 9.81, 0.0] m/s^2 is not in the file" in note for note in to_urdf(Dynamics.of(model)).notes
    )

"""Joints that count the other way round or stand under each other's name: named as that, and nothing else is."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from robot_ident.diagnosis.diagnose import diagnose
from robot_ident.diagnosis.measuring.axes import wirings, wrong_axes
from robot_ident.diagnosis.measuring.fitted_fault import FittedFault
from robot_ident.model.structure import Structure
from robot_ident.recording import Recording, process
from robot_ident.regression.evidence import gather
from robot_ident.regression.gram import base_gram
from robot_ident.robot import Robot
from robot_ident.robot.robot import Definition
from robot_ident.robot.robot_file import definition_of, robot_of
from robot_ident.signals.motion import Motion
from robot_ident.testbed.phenomena import plant_physics
from robot_ident.testbed.simulation import Play


@pytest.fixture(scope="module")
def recorded(bench: Any) -> Any:
    """Return a function from hidden effects to three recordings as they should be, made once."""

    @cache
    def made(effects: tuple[str, ...] = ()) -> tuple[Recording, ...]:
        plays = [Play.of(bench.robot, plant_physics(bench.robot, effects), bench.motions[k]) for k in range(3)]
        return tuple(play.record(6, noise=0.1, seed=20 + k) for k, play in enumerate(plays))

    return made


def mirrored(joint: int, *, position: bool = True, effort: bool = True) -> Any:
    """Return what a driver writes that counts a joint the other way round."""

    def write(r: Recording) -> Recording:
        q, tau = r.q.copy(), r.tau.copy()
        if position:
            q[:, joint] = -q[:, joint]
        if effort:
            tau[:, joint] = -tau[:, joint]
        return replace(r, q=q, tau=tau, dq=None)

    return write


def exchanged(a: int, b: int, *, position: bool = True, effort: bool = True) -> Any:
    """Return what a driver writes that takes two joints for each other."""

    def write(r: Recording) -> Recording:
        q, tau = r.q.copy(), r.tau.copy()
        if position:
            q[:, a], q[:, b] = r.q[:, b], r.q[:, a]
        if effort:
            tau[:, a], tau[:, b] = r.tau[:, b], r.tau[:, a]
        return replace(r, q=q, tau=tau, dq=None)

    return write


def found_in(bench: Any, recordings: Any, write: Any) -> list[FittedFault]:
    """Return what the test for such mistakes finds, best first."""
    evidence = gather([process(write(r), bench.robot) for r in recordings], bench.structure)
    return sorted(wrong_axes(evidence, base_gram(evidence)), key=lambda f: -f.held_out)


@pytest.mark.parametrize(
    ("write", "labels"),
    [
        # the arm's two parallel axes mirror each other's mistake: both are said, one as what it is tied with
        (mirrored(1), {"mirrored_joint@joint_2", "mirrored_joint@joint_3"}),
        pytest.param(exchanged(1, 2), {"exchanged_joints@joint_2"}, marks=pytest.mark.long),
    ],
)
def test_it_is_named_and_nothing_else(bench: Any, recorded: Any, write: Any, labels: set[str]) -> None:
    found = diagnose([process(write(r), bench.robot) for r in recorded()], bench.structure)
    (named,) = found.missing
    assert {named.label, *named.tied_with} == labels
    assert named.explained > 0.95
    assert named.fix and named.effect.measuring
    assert sum(named.mse_after.values()) < 0.05 * sum(named.mse_before.values())


def test_a_mirrored_position_tells_of_the_sign_of_the_effort_too(bench: Any, recorded: Any) -> None:
    found = found_in(bench, recorded(), mirrored(1, effort=False))
    (mine,) = (f for f in found if f.label == "mirrored_joint@joint_2")
    assert "axis" in mine.fix and "joint_2: {effort: {sign: -1}}" in mine.fix
    assert [p.name for p in mine.parameters] == ["factor of the position of joint_2"]


def test_what_the_parameters_absorb_is_not_spoken_of(bench: Any, recorded: Any) -> None:
    """Seen in a mirror the arm is another arm; and a first joint that turns with the wrong effort has its sign wrong,
    which the robot YAML can tell.
    """
    assert found_in(bench, recorded(), mirrored(0)) == []
    assert found_in(bench, recorded(), mirrored(0, effort=False)) == []
    assert found_in(bench, recorded(), mirrored(0, position=False)) == []


@pytest.mark.parametrize(
    ("position", "effort", "words"),
    [(True, False, "positions"), (False, True, "efforts"), (True, True, "positions and efforts")],
)
@pytest.mark.parametrize(("a", "b"), [(1, 2), (0, 1)])
def test_exchanged_joints(bench: Any, recorded: Any, position: bool, effort: bool, words: str, a: int, b: int) -> None:
    """With an effect of the arm besides, which is for the next diagnosis."""
    best, *_ = found_in(bench, recorded(("stribeck@joint_1",)), exchanged(a, b, position=position, effort=effort))
    assert best.label == f"exchanged_joints@joint_{a + 1}"
    assert f"the {words} of joint_{a + 1} and joint_{b + 1}" in best.fix
    assert {p.value for p in best.parameters} == {b + 1.0}
    assert len(best.parameters) == position + effort


@pytest.mark.parametrize("effects", [(), ("gravity_spring@joint_3",), ("rotor_inertia@joint_3",)])
def test_not_where_the_joints_are_right(bench: Any, recorded: Any, effects: tuple[str, ...]) -> None:
    assert found_in(bench, recorded(effects), lambda recording: recording) == []


def test_a_wiring_undoes_what_the_driver_did(bench: Any) -> None:
    """With signs and names put back by the wiring, the torque of the true motion is what stands in the recording."""
    rng = np.random.default_rng(1)
    true = Motion(*rng.standard_normal((3, 40, 3)))
    theta = rng.standard_normal(len(bench.structure.names))
    tau = bench.structure.columns(true) @ theta
    writers = {(j,): mirrored(j) for j in range(3)} | {(a, b): exchanged(a, b) for a, b in ((0, 1), (0, 2), (1, 2))}
    for wiring in (w for w in wirings(bench.robot) if len(w.wrong) == 2):
        write = writers[wiring.joints]
        q, dq, ddq = (
            write(Recording(bench.robot.joints, np.arange(40.0), x, tau)) for x in (true.q, true.dq, true.ddq)
        )
        read = Motion(q.q, dq.q, ddq.q)
        np.testing.assert_allclose(wiring.rows(bench.structure.columns(wiring.motion(read))) @ theta, q.tau)


def test_the_axis_put_right_in_the_urdf_ends_it(bench: Any, recorded: Any) -> None:
    """Followed to the letter, the remedy leaves no more than noise."""
    robot = with_axis_turned(bench.robot, "joint_2")
    evidence = gather([process(mirrored(1)(r), robot) for r in recorded()], Structure.build(robot))
    left, dof = sum(np.sum(r**2) for r in evidence.residual), sum(t.dof.sum() for t in evidence.trajectories)
    assert left < 1.1 * dof


def with_axis_turned(robot: Robot, joint: str) -> Robot:
    from xml.etree import ElementTree

    known = definition_of(robot)
    tree = ElementTree.fromstring(known.urdf)
    (found,) = (j for j in tree.iter("joint") if j.get("name") == joint)
    axis, limit = found.find("axis"), found.find("limit")
    assert axis is not None and limit is not None
    axis.set("xyz", " ".join(str(-float(v)) for v in axis.get("xyz", "").split()))
    lower, upper = (float(limit.get(key, "0")) for key in ("lower", "upper"))
    limit.set("lower", str(-upper))
    limit.set("upper", str(-lower))
    return robot_of(Definition(known.yaml, ElementTree.tostring(tree, encoding="unicode")), robot.source)

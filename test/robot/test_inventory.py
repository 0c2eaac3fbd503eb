"""What a URDF says of its joints: the chain that moves, what follows, what looks like a gripper."""

from __future__ import annotations

import pytest

from robot_ident.errors import InputError
from robot_ident.robot.urdf import read_inventory

JOINT = (
    '<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
    '<limit lower="{lower}" upper="{upper}" velocity="{velocity}" effort="{effort}"/>{more}</joint>'
)


def urdf(*joints: tuple[str, str, str, str], more: dict[str, str] | None = None, extra: str = "") -> str:
    """Return a URDF of (name, kind, parent, child) joints."""
    links = dict.fromkeys(link for joint in joints for link in joint[2:])
    size = {"lower": -1.0, "upper": 1.0, "velocity": 2.0, "effort": 0.0}
    text = "".join(
        JOINT.format(name=name, kind=kind, parent=parent, child=child, more=(more or {}).get(name, ""), **size)
        for name, kind, parent, child in joints
    )
    return f'<robot name="arm">{"".join(f"""<link name="{link}"/>""" for link in links)}{text}{extra}</robot>'


ARM = [("a", "revolute", "base", "l1"), ("b", "revolute", "l1", "l2"), ("c", "continuous", "l2", "l3")]


def names(text: str, wanted: tuple[str, ...] = ()) -> list[str]:
    return [joint.name for joint in read_inventory(text, "x.urdf", wanted).chain]


def test_a_plain_chain() -> None:
    inventory = read_inventory(urdf(*ARM, ("flange", "fixed", "l3", "tool0")), "x.urdf")
    assert [joint.name for joint in inventory.chain] == ["a", "b", "c"]
    assert inventory.end_effector == "tool0" and inventory.gripper == ()
    a, _, c = inventory.chain
    assert a.position == (-1.0, 1.0) and c.position is None
    assert a.velocity == 2.0 and a.effort is None, "an effort of zero stands for none"
    assert inventory.of_kind("fixed") == ("flange",)


def test_a_gripper_by_what_follows_it() -> None:
    fingers = [("slide", "prismatic", "l3", "f1"), ("twin", "prismatic", "l3", "f2")]
    text = urdf(*ARM, ("hand", "fixed", "l3", "hand"), *fingers, more={"twin": '<mimic joint="slide"/>'})
    inventory = read_inventory(text, "x.urdf")
    assert [joint.name for joint in inventory.chain] == ["a", "b", "c"]
    assert inventory.gripper == ("slide",) and inventory.mimics == {"twin": "slide"}
    assert inventory.end_effector == "hand"


def test_a_gripper_by_its_name() -> None:
    assert names(urdf(*ARM, ("left_finger", "revolute", "l3", "f1"))) == ["a", "b", "c"]


def test_a_long_slide_is_an_axis() -> None:
    assert names(urdf(*ARM, ("z", "prismatic", "l3", "l4"))) == ["a", "b", "c", "z"]


def test_a_hand_of_three_fingers_ends_the_arm() -> None:
    digits = [(f"d{k}", "revolute", "l3", f"f{k}") for k in range(3)]
    assert names(urdf(*ARM, *digits)) == ["a", "b", "c"]


def test_of_two_arms_the_one_that_was_recorded() -> None:
    other = [("x", "revolute", "base", "m1"), ("y", "revolute", "m1", "m2")]
    assert names(urdf(*ARM, *other)) == ["a", "b", "c"]
    assert names(urdf(*ARM, *other), ("y", "x")) == ["x", "y"]


def test_the_ratio_of_a_transmission() -> None:
    transmission = (
        '<transmission name="t"><joint name="b"/><actuator name="m"><mechanicalReduction>-101</mechanicalReduction>'
        "</actuator></transmission>"
    )
    ratios = [joint.gear_ratio for joint in read_inventory(urdf(*ARM, extra=transmission), "x.urdf").chain]
    assert ratios == [None, 101.0, None]


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("no xml", "not a URDF"),
        ("<sdf/>", "first element is <sdf>"),
        ('<robot name="r"><link name="a"/></robot>', "no joint in it moves"),
        (urdf(*ARM).replace('upper="1.0"', 'upper="pi"'), "limit upper = 'pi' is no number"),
        (
            '<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:arm/></robot>',
            "is a xacro file; give its output",
        ),
    ],
)
def test_refusals(text: str, why: str) -> None:
    with pytest.raises(InputError, match=f"x.urdf: .*{why}"):
        read_inventory(text, "x.urdf")


LOOPS = {
    "part of a loop": [("a", "revolute", "l1", "l2"), ("b", "revolute", "l2", "l1"), ("c", "revolute", "x", "y")],
    "hangs on two joints": [*ARM, ("d", "revolute", "base", "l3")],
    "two joints are called 'a'": [*ARM, ("a", "revolute", "l3", "l4")],
    "has no name": [*ARM, ("", "revolute", "l3", "l4")],
}


@pytest.mark.parametrize("message", LOOPS)
def test_what_is_no_tree_is_refused(message: str) -> None:
    with pytest.raises(InputError, match=message):
        read_inventory(urdf(*LOOPS[message]), "x.urdf")


@pytest.mark.parametrize("address", ["http://ros.org/wiki/xacro", "http://www.ros.org/wiki/xacro"])
def test_a_xacro_is_known_by_either_of_its_addresses(address: str) -> None:
    text = urdf(*ARM, extra="<xacro:property/>").replace("<robot ", f'<robot xmlns:xacro="{address}" ')
    with pytest.raises(InputError, match="is a xacro file"):
        read_inventory(text, "x.urdf")


def test_limits_that_are_no_limits() -> None:
    text = urdf(*ARM).replace('velocity="2.0"', 'velocity="nan"').replace('lower="-1.0"', 'lower="-inf"')
    joint = read_inventory(text.replace('effort="0.0"', 'effort="-3"'), "x.urdf").joints[0]
    assert joint.position is None and joint.velocity is None and joint.effort is None


def test_a_long_chain() -> None:
    joints = [(f"j{k}", "revolute", f"l{k}", f"l{k + 1}") for k in range(2000)]
    assert len(read_inventory(urdf(*joints), "x.urdf").chain) == 2000

"""Effort that stands elsewhere than beside the positions: other topics, other fields, arrays of numbers."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from robot_ident.bags import BagWriter, Series, Topic, read_for
from robot_ident.bags.storage import JOINT_STATE, NUMBERS
from robot_ident.errors import InputError
from robot_ident.robot import Robot, load_robot
from robot_ident.robot.locked_joints import hold
from robot_ident.signals.motion import Array

from .conftest import START, STORE, serialise

JOINTS = ("joint_1", "joint_2", "joint_3")
RATE, SECONDS, LATE = 100.0, 4.0, 3_000_000  # Hz, s, ns from stamp to receipt


def effort(t: Array) -> Array:
    """Return efforts [N, 3] that a line between samples follows to 1e-3."""
    return np.column_stack([10 * np.sin(t), 20 * np.cos(t), 5 + t])


def array_of(values: Array, label: str = "") -> bytes:
    types = STORE.types
    dimensions = [types["std_msgs/msg/MultiArrayDimension"](label, len(values), len(values))] if label else []
    layout = types["std_msgs/msg/MultiArrayLayout"](dimensions, 0)
    return bytes(STORE.serialize_cdr(types[NUMBERS](layout, np.asarray(values, dtype=float)), NUMBERS))


Robots = Callable[..., Robot]


@pytest.fixture
def declared(tmp_path: Path, checkout: Path) -> Robots:
    def make(common: dict[str, Any], **single: dict[str, Any]) -> Robot:
        joints = {name: {"effort": single[name]} if name in single else {} for name in JOINTS}
        data = {
            "schema": "robot_ident/robot/1",
            "name": "arm",
            "urdf": str(checkout / "config/robots/kuka_ir361.urdf"),
            "effort": common,
            "joints": joints,
        }
        path = tmp_path / "arm.yaml"
        path.write_text(yaml.safe_dump(data), encoding="utf-8")
        return load_robot(path)

    return make


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    """Write a bag of drives on topics of their own: states without effort at 100 Hz, efforts elsewhere at 250 Hz."""
    states, drives, arrays, bare = "/joint_states", "/drives", "/torques", "/efforts"
    path = tmp_path / "bag"
    topics = [Topic(states, JOINT_STATE), Topic(drives, JOINT_STATE), Topic(arrays, NUMBERS), Topic(bare, JOINT_STATE)]
    rows: list[tuple[int, str, bytes]] = []
    for t in np.arange(0.0, SECONDS, 1 / RATE):
        stamp = START + round(t * 1e9)
        q = [t, 2 * t, 3 * t]
        rows.append((stamp + LATE, states, serialise(JOINTS, stamp, q)))
    for t in np.arange(0.5, SECONDS + 1, 1 / 250.0):
        stamp, tau = START + round(t * 1e9), effort(np.array([t]))[0]
        backwards = tau[::-1]
        rows.append((stamp + LATE, drives, serialise(JOINTS[::-1], stamp, 2 * backwards, backwards + 1, backwards)))
        rows.append((stamp + LATE, arrays, array_of(np.append(tau, 99.0), "drive")))
        rows.append((stamp + LATE, bare, serialise(JOINTS, 0, tau=tau)))
    with BagWriter(path, topics) as writer:
        for log, topic, data in sorted(rows):
            writer.write(topic, data, log)
    return path


def check(tau: Array, t: Array, factor: float = 1.0, shift: float = 0.0) -> None:
    assert len(tau) == round((SECONDS - 0.5) * RATE)
    np.testing.assert_allclose(tau, factor * effort(t + 0.5) + shift, atol=2e-3 * factor)


@pytest.mark.parametrize(
    ("common", "factor", "shift"),
    [
        ({"topic": "/efforts"}, 1.0, 0.0),
        ({"topic": "/drives", "field": "velocity"}, 1.0, 1.0),
        ({"topic": "/drives", "field": "position"}, 2.0, 0.0),
        ({"topic": "/torques", "field": "data"}, 1.0, 0.0),
    ],
)
def test_effort_is_found_where_the_yaml_says(
    declared: Robots, bag: Path, common: dict[str, Any], factor: float, shift: float
) -> None:
    recording = read_for(bag, declared(common))
    assert recording.names == JOINTS
    np.testing.assert_allclose(recording.q[:, 1], 2 * recording.t, atol=1e-8)
    check(recording.tau, recording.t - recording.t[0], factor, shift)
    assert any("50 of 400 positions have no effort" in note for note in recording.notes)


def test_each_joint_may_have_its_own_place(declared: Robots, bag: Path) -> None:
    places = {
        "joint_1": {"topic": "/efforts"},
        "joint_2": {"topic": "/drives", "field": "velocity"},
        "joint_3": {"topic": "/torques", "field": "data[3]"},
    }
    recording = read_for(bag, declared({"quantity": "torque"}, **places))
    tau = effort(recording.t)
    np.testing.assert_allclose(
        recording.tau, np.column_stack([tau[:, 0], tau[:, 1] + 1, 99 + 0 * tau[:, 2]]), atol=4e-3
    )


def test_a_field_beside_the_positions_is_taken_as_it_is(declared: Robots, tmp_path: Path) -> None:
    path = tmp_path / "bag"
    t = np.arange(0.0, SECONDS, 1 / RATE)
    with BagWriter(path, [Topic("/joint_states", JOINT_STATE)]) as writer:
        stamps = START + np.round(t * 1e9).astype(np.int64)
        for stamp, topic, row in Series(
            "/joint_states", JOINTS, stamps, effort(t), 3 * effort(t), effort(2 * t)
        ).messages():
            writer.write(topic, row, stamp)
    recording = read_for(path, declared({}, joint_2={"field": "velocity"}))
    np.testing.assert_array_equal(recording.tau[:, 1], 3 * effort(t)[:, 1])
    np.testing.assert_array_equal(recording.tau[:, [0, 2]], effort(2 * t)[:, [0, 2]])
    assert recording.dq is None, "what is no velocity must not be taken for one"
    with pytest.raises(InputError, match="position needs the topic"):
        declared({"field": "position"})
    with pytest.raises(InputError, match="holds the positions themselves"):
        read_for(path, declared({"topic": "/joint_states", "field": "position"}))


def test_a_hole_in_the_efforts_is_not_bridged(declared: Robots, bag: Path, tmp_path: Path) -> None:
    from robot_ident.bags import read_messages

    other, begin = tmp_path / "holed", START + 2_000_000_000
    topics = [Topic("/joint_states", JOINT_STATE), Topic("/efforts", JOINT_STATE)]
    with BagWriter(other, topics) as writer:
        for one in read_messages(bag, ["/joint_states", "/efforts"]):
            if one.topic.name == "/joint_states" or not begin < one.log_time < begin + 1_000_000_000:
                writer.write(one.topic.name, one.data, one.log_time)
    recording = read_for(other, declared({"topic": "/efforts"}))
    assert not np.any((recording.t > 2.01) & (recording.t < 2.99))
    np.testing.assert_allclose(recording.tau, effort(recording.t), atol=4e-3)


def test_joints_that_are_held_don_t_move_the_places_of_the_others(declared: Robots, bag: Path) -> None:
    robot = hold(declared({"topic": "/torques", "field": "data"}), ["joint_3"], {"joint_1": 0.0, "joint_2": 0.0})
    recording = read_for(bag, robot).with_joints(("joint_3",))
    np.testing.assert_allclose(recording.tau[:, 0], effort(recording.t)[:, 2], atol=2e-3)


@pytest.mark.parametrize(
    ("common", "told"),
    [
        ({"topic": "/torques", "field": "data[7]"}, "holds no number for the effort of joint_1 in field data"),
        ({"topic": "/efforts", "field": "velocity"}, "holds no number for the effort of joint_1 in field velocity"),
        ({"topic": "/drives", "field": "data"}, "'/drives' is no std_msgs/msg/Float64MultiArray"),
        ({"topic": "/currents", "field": "velocity"}, "'/currents' is not in it"),
        ({"topic": "/torques"}, "'/torques' is no sensor_msgs/msg/JointState"),
    ],
)
def test_a_wrong_place_is_named(declared: Robots, bag: Path, common: dict[str, Any], told: str) -> None:
    with pytest.raises(InputError, match="topic") as caught:
        read_for(bag, declared(common))
    assert told in str(caught.value)
    assert "\n" not in str(caught.value)


def test_an_unknown_field_is_named_with_the_known_ones(declared: Robots) -> None:
    for common, single in (({"field": "effrot"}, {}), ({}, {"joint_2": {"field": "effrot"}})):
        with pytest.raises(InputError, match="effort, velocity and position of a JointState, data and data") as caught:
            declared(common, **single)
        assert "did you mean 'effort'" in str(caught.value)
        assert "\n" not in str(caught.value)


def test_bytes_that_are_no_numbers_are_left_out(declared: Robots, bag: Path, tmp_path: Path) -> None:
    from robot_ident.bags import read_messages

    other = tmp_path / "broken"
    topics = [Topic("/joint_states", JOINT_STATE), Topic("/torques", NUMBERS)]
    rng = np.random.default_rng(0)
    with BagWriter(other, topics) as writer:
        for number, one in enumerate(read_messages(bag, ["/joint_states", "/torques"])):
            data = one.data
            if one.topic.name == "/torques" and number % 7 == 0:
                data = data[: rng.integers(0, len(data) - 1)]
            writer.write(one.topic.name, data, one.log_time)
    recording = read_for(other, declared({"topic": "/torques", "field": "data"}))
    np.testing.assert_allclose(recording.tau, effort(recording.t), atol=4e-3)

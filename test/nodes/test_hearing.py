"""All messages that wait are taken at one look, by a node in this process."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any, ClassVar

import pytest

pytest.importorskip("rclpy")

import rclpy
from rclpy.duration import Duration
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState

from robot_ident.nodes.node import BaseNode, Executor, reliable
from robot_ident.nodes.parameters import Parameter
from robot_ident.nodes.subscriptions import Hearing, hear, poll

COUNT = 50
QUICK = {
    "best effort": QoSProfile(
        depth=1, reliability=ReliabilityPolicy.BEST_EFFORT, durability=DurabilityPolicy.TRANSIENT_LOCAL
    ),
    "volatile": QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE),
    "both": QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT),
}


class Listener(BaseNode):
    """Listens to what a test has it listen to."""

    node_name: ClassVar[str] = "listener"
    description: ClassVar[str] = "listens"
    table: ClassVar[tuple[Parameter, ...]] = ()


@pytest.fixture
def listener(domain: int) -> Iterator[Listener]:
    rclpy.init(domain_id=domain)
    node = Listener()
    yield node
    node.destroy_node()
    rclpy.shutdown()


def send(node: BaseNode) -> None:
    """Publish messages numbered by their position, and wait until all of them wait to be taken."""
    sender = node.create_publisher(JointState, "numbers", reliable(COUNT))
    for number in range(COUNT):
        sender.publish(JointState(position=[float(number)]))
    assert sender.wait_for_all_acked(Duration(seconds=20))


@pytest.mark.parametrize("raw", [False, True])
def test_one_look_takes_all_that_wait(listener: Listener, raw: bool) -> None:
    taken: list[float] = []

    def take_raw(data: bytes, info: dict[str, Any]) -> None:
        assert info["source_timestamp"] > 0
        taken.append(deserialize_message(data, JointState).position[0])

    if raw:
        Hearing(listener, JointState, "numbers", reliable(COUNT), take=take_raw, raw=True)
    else:
        hear(listener, JointState, "numbers", lambda message: taken.append(message.position[0]), reliable(COUNT))
    send(listener)
    assert listener.take_messages()
    assert taken == [float(number) for number in range(COUNT)]


def test_who_listens_no_more_is_handed_nothing(listener: Listener) -> None:
    taken: list[float] = []

    def take(message: JointState) -> None:
        taken.append(message.position[0])
        hearing.end()

    hearing = hear(listener, JointState, "numbers", take, reliable(COUNT))
    send(listener)
    assert listener.take_messages()
    assert taken == [0.0]


def test_what_somebody_else_looks_after_is_left_to_them(listener: Listener) -> None:
    taken: list[float] = []
    take = poll(listener, JointState, "numbers", lambda message: taken.append(message.position[0]), reliable(COUNT))
    send(listener)
    assert not listener.take_messages()
    assert not taken
    take()
    assert taken == [float(number) for number in range(COUNT)]


@pytest.mark.parametrize("polled", [False, True])
@pytest.mark.parametrize("reliability", list(QUICK))
def test_a_publisher_that_offers_less_is_heard(listener: Listener, polled: bool, reliability: str) -> None:
    """Best effort, volatile or both, while reliable and transient local were asked for."""
    taken: list[float] = []

    def take(message: JointState) -> None:
        taken.append(message.position[0])

    asked = QoSProfile(depth=COUNT, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    look = (
        poll(listener, JointState, "numbers", take, asked)
        if polled
        else hear(listener, JointState, "numbers", take, asked) and None
    )
    sender = listener.create_publisher(JointState, "numbers", QUICK[reliability])
    executor, deadline = Executor(), time.monotonic() + 20
    executor.add_node(listener)
    while not taken and time.monotonic() < deadline:
        sender.publish(JointState(position=[1.0]))
        time.sleep(0.01)
        executor.run_ready()
        listener.take_messages()
        if look is not None:
            look()
    assert taken
    others = [info.qos_profile for info in listener.get_subscriptions_info_by_topic("/numbers")]
    assert [profile.reliability for profile in others] == [QUICK[reliability].reliability]


def test_what_can_not_be_heard_is_told(listener: Listener, capfd: pytest.CaptureFixture[str]) -> None:
    """A deadline that is asked for and not offered is no matter of losing a message or two."""
    asked = QoSProfile(depth=1, deadline=Duration(seconds=0.1))
    hear(listener, JointState, "numbers", lambda message: None, asked)
    listener.create_publisher(JointState, "numbers", QoSProfile(depth=1))
    executor, deadline, said = Executor(), time.monotonic() + 20, ""
    executor.add_node(listener)
    while "not heard" not in said and time.monotonic() < deadline:
        time.sleep(0.1)
        executor.run_ready()
        said += capfd.readouterr().err
    assert "/numbers" in said and "deadline" in said.lower()


class Awaited:
    """Awaits until it is let go, and counts how often it was looked at."""

    def __init__(self) -> None:
        self.looks, self.let_go = 0, False

    def __await__(self) -> Iterator[None]:
        while not self.let_go:
            self.looks += 1
            assert self.looks < 100, "whoever awaits keeps the executor to itself"
            yield


def test_messages_have_their_turn_while_something_is_awaited(listener: Listener) -> None:
    """A publisher that comes to rest before it is inactive hears clock and joint states on its way."""
    awaited, taken = Awaited(), []
    hear(listener, JointState, "numbers", taken.append, reliable(COUNT))

    async def rest() -> str:
        await awaited
        return "at rest"

    executor = Executor()
    executor.add_node(listener)
    task = executor.create_task(rest)
    for look in (1, 2):
        executor.run_ready()
        assert awaited.looks == look and not task.done()
    send(listener)
    assert listener.take_messages() and len(taken) == COUNT
    awaited.let_go = True
    executor.run_ready()
    assert task.done() and task.result() == "at rest"

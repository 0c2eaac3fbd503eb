"""Takes the messages of a topic that wait, all at once: being woken for one costs more than what is done with it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

from rclpy.callback_groups import CallbackGroup
from rclpy.exceptions import InvalidHandle
from rclpy.qos import QoSCompatibility, QoSProfile, qos_check_compatible
from rclpy.subscription import Subscription

from robot_ident.nodes.common import BaseNode, overridable

_AT_ONCE = 200  # messages that are taken in one go, before timers and services have their turn
_LOOK = 2.0  # s between looks at who publishes on a topic that nothing wakes for


def hear(node: BaseNode, kind: type, topic: str, take: Callable[[Any], None], profile: QoSProfile) -> Subscription:
    """Hand every message of a topic to `take`, all that wait at once."""
    return _hear(node, kind, topic, lambda message, _: take(message), profile, raw=False)


def hear_raw(
    node: BaseNode, kind: type, topic: str, take: Callable[[bytes, dict[str, Any]], None], profile: QoSProfile
) -> Subscription:
    """Hand every serialized message of a topic, and what the middleware tells of it, to `take`, all that wait at
    once.
    """
    return _hear(node, kind, topic, take, profile, raw=True)


def _hear(
    node: BaseNode,
    kind: type,
    topic: str,
    take: Callable[[Any, dict[str, Any]], None],
    profile: QoSProfile,
    *,
    raw: bool,
) -> Subscription:
    """Subscribe so that one wake of the executor takes all messages that wait: on a loaded machine a node catches
    up before any is lost.
    """

    def take_all(message: Any, info: dict[str, Any]) -> None:
        take(message, info)
        for waiting in _waiting(subscription):
            take(*waiting)

    subscription = node.create_subscription(
        kind, topic, take_all, profile, raw=raw, qos_overriding_options=overridable()
    )
    return subscription


def poll(
    node: BaseNode, kind: type, topic: str, take: Callable[[Any], None], profile: QoSProfile
) -> Callable[[], None]:
    """Return what hands all messages of a topic that wait to `take` when it is called, by any thread.

    For who looks at every tick anyway: being woken for a message costs more than all that is done with it.
    """
    subscription = node.create_subscription(
        kind, topic, take, profile, callback_group=_Unwoken(), qos_overriding_options=overridable()
    )
    told: set[bytes] = set()

    def look() -> None:
        """Say which publishers can't be heard; nobody else does."""
        for offer in node.get_publishers_info_by_topic(subscription.topic_name):
            fits, why = qos_check_compatible(offer.qos_profile, subscription.qos_profile)
            gid = bytes(offer.endpoint_gid)
            if fits == QoSCompatibility.ERROR and gid not in told:
                told.add(gid)
                node.get_logger().warning(f"{offer.node_name} is not heard on {subscription.topic_name}: {why}")

    def take_all() -> None:
        for message, _ in _waiting(subscription):
            take(message)

    node.every(_LOOK, look)
    return take_all


class _Unwoken(CallbackGroup):
    """Subscriptions of which nothing wakes the executor: neither messages nor what the middleware tells of them."""

    def can_execute(self, entity: Any) -> bool:
        """Return False: somebody else looks after them."""
        return False

    def beginning_execution(self, entity: Any) -> bool:
        """Return False likewise."""
        return False

    def ending_execution(self, entity: Any) -> None:
        """Do nothing: nothing has begun."""


def _waiting(subscription: Subscription) -> Iterator[tuple[Any, dict[str, Any]]]:
    """Yield the messages that wait, with what the middleware tells of each, until somebody destroys the subscription.

    No more than `_AT_ONCE`.
    """
    for _ in range(_AT_ONCE):
        try:
            with subscription.handle:
                found = subscription.handle.take_message(subscription.msg_type, subscription.raw)
        except InvalidHandle:
            return
        if found is None:
            return
        yield found

"""Hears a topic: its messages are taken as they wait, all at once.

A subscription asks for no more than every publisher offers, as `ros2 bag record` does: best effort where one of them is
best effort, volatile where one is volatile.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import Any

from rclpy.event_handler import QoSRequestedIncompatibleQoSInfo, SubscriptionEventCallbacks
from rclpy.qos import DurabilityPolicy, QoSPolicyKind, QoSProfile, ReliabilityPolicy, qos_policy_name_from_kind
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.subscription import Subscription

from robot_ident.nodes.node import AT_ONCE, BaseNode, left_to_takers, overridable, waiting

_LEAST = {
    QoSPolicyKind.RELIABILITY: ("reliability", ReliabilityPolicy.BEST_EFFORT),
    QoSPolicyKind.DURABILITY: ("durability", DurabilityPolicy.VOLATILE),
}


class Hearing:
    """One subscription for as long as it is wanted, whatever its publishers turn out to offer."""

    def __init__(
        self,
        node: BaseNode,
        kind: type,
        topic: str,
        profile: QoSProfile,
        *,
        take: Callable[[Any, dict[str, Any]], None] | None = None,
        raw: bool = False,
    ) -> None:
        """Subscribe. take(message, info): is handed all messages that wait, again and again; without it `waiting` hands
        them out. raw: serialized messages.
        """
        self._node, self._kind, self._topic, self._take, self._raw = node, kind, topic, take, raw
        if take is not None:
            node.takers.append(self._take_all)
        self._subscription = self._subscribe(profile, overridable())
        self.topic_name: str = self._subscription.topic_name

    @property
    def profile(self) -> QoSProfile:
        """What is asked for now."""
        return self._subscription.qos_profile

    def _subscribe(self, profile: QoSProfile, options: QoSOverridingOptions | None = None) -> Subscription:
        return self._node.create_subscription(
            self._kind,
            self._topic,
            left_to_takers,
            profile,
            event_callbacks=SubscriptionEventCallbacks(incompatible_qos=self._adapt),
            qos_overriding_options=options,
            raw=self._raw,
        )

    def _take_all(self) -> bool:
        """Hand on all messages that wait; return whether there were any."""
        if self._take is None:
            return False
        took = False
        for message, info in self.waiting():
            self._take(message, info)
            took = True
        return took

    def _adapt(self, event: QoSRequestedIncompatibleQoSInfo) -> None:
        """Ask for less, since a publisher has come that offers less."""
        name = qos_policy_name_from_kind(event.last_policy_kind)
        policy, least = _LEAST.get(event.last_policy_kind, ("", None))
        profile = self._subscription.qos_profile
        if not policy or getattr(profile, policy) == least:
            told = f"a publisher on {self.topic_name} is not heard: what it offers as {name} does not suffice"
            self._node.get_logger().warning(told)
            return
        setattr(profile, policy, least)
        self._take_all()
        old, self._subscription = self._subscription, self._subscribe(profile)
        self._node.destroy_subscription(old)
        self._node.get_logger().info(
            f"{self.topic_name}: a publisher offers {least.name.lower()} {policy}; so do we ask"
        )

    def waiting(self, until_ns: int | None = None) -> Iterator[tuple[Any, dict[str, Any]]]:
        """Yield the messages that wait, with what the middleware tells of each, until somebody ends this.

        No more than `AT_ONCE`; with until_ns: all, up to the first that was received after that time.
        """
        for taken, found in enumerate(waiting(self._subscription)):
            yield found
            if until_ns is None:
                if taken + 1 == AT_ONCE:
                    return
            elif (found[1]["received_timestamp"] or time.time_ns()) > until_ns:
                return

    def end(self) -> None:
        """Listen no more."""
        if self._take is not None:
            self._node.takers.remove(self._take_all)
        self._node.destroy_subscription(self._subscription)


def hear(node: BaseNode, kind: type, topic: str, take: Callable[[Any], None], profile: QoSProfile) -> Hearing:
    """Hand every message of a topic to `take`, all that wait at once."""
    return Hearing(node, kind, topic, profile, take=lambda message, _: take(message))


def poll(
    node: BaseNode, kind: type, topic: str, take: Callable[[Any], None], profile: QoSProfile
) -> Callable[[], None]:
    """Return what hands all messages of a topic that wait to `take` when it is called, by any thread.

    For who looks at every tick anyway.
    """
    hearing = Hearing(node, kind, topic, profile)

    def take_all() -> None:
        for message, _ in hearing.waiting():
            take(message)

    return take_all

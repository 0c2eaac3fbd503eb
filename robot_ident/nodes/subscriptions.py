"""Takes the messages of a topic that wait, all at once: being woken for one costs more than what is done with it.

A subscription asks for no more than every publisher offers, as `ros2 bag record` does: best effort where one of them is
best effort, volatile where one is volatile.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import Any

from rclpy.callback_groups import CallbackGroup
from rclpy.event_handler import QoSRequestedIncompatibleQoSInfo, SubscriptionEventCallbacks
from rclpy.exceptions import InvalidHandle
from rclpy.qos import DurabilityPolicy, QoSPolicyKind, QoSProfile, ReliabilityPolicy, qos_policy_name_from_kind
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.subscription import Subscription

from robot_ident.nodes.node import BaseNode, overridable

_AT_ONCE = 200  # messages that are taken in one go, before timers and services have their turn
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
        """Subscribe. take(message, info): is handed all messages that wait whenever one comes; without it nothing
        wakes, and `waiting` hands them out. raw: serialized messages.
        """
        self._node, self._kind, self._topic, self._take, self._raw = node, kind, topic, take, raw
        self._group = _Unwoken() if take is None else None
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
            self._woken,
            profile,
            callback_group=self._group,
            event_callbacks=SubscriptionEventCallbacks(incompatible_qos=self._adapt),
            qos_overriding_options=options,
            raw=self._raw,
        )

    def _woken(self, message: Any, info: dict[str, Any]) -> None:
        if self._take is not None:
            self._take(message, info)
            for waiting in self.waiting():
                self._take(*waiting)

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
        if self._take is not None:
            for waiting in self.waiting():
                self._take(*waiting)
        old, self._subscription = self._subscription, self._subscribe(profile)
        self._node.destroy_subscription(old)
        self._node.get_logger().info(
            f"{self.topic_name}: a publisher offers {least.name.lower()} {policy}; so do we ask"
        )

    def waiting(self, until_ns: int | None = None) -> Iterator[tuple[Any, dict[str, Any]]]:
        """Yield the messages that wait, with what the middleware tells of each, until somebody ends this.

        No more than `_AT_ONCE`; with until_ns: all, up to the first that was received after that time.
        """
        taken = 0
        while until_ns is not None or taken < _AT_ONCE:
            subscription = self._subscription
            try:
                with subscription.handle:
                    found = subscription.handle.take_message(subscription.msg_type, subscription.raw)
            except InvalidHandle:
                return
            if found is None:
                return
            taken += 1
            yield found
            if until_ns is not None and (found[1]["received_timestamp"] or time.time_ns()) > until_ns:
                return

    def end(self) -> None:
        """Listen no more."""
        self._node.destroy_subscription(self._subscription)


def hear(node: BaseNode, kind: type, topic: str, take: Callable[[Any], None], profile: QoSProfile) -> Hearing:
    """Hand every message of a topic to `take`, all that wait at once."""
    return Hearing(node, kind, topic, profile, take=lambda message, _: take(message))


def poll(
    node: BaseNode, kind: type, topic: str, take: Callable[[Any], None], profile: QoSProfile
) -> Callable[[], None]:
    """Return what hands all messages of a topic that wait to `take` when it is called, by any thread.

    For who looks at every tick anyway: being woken for a message costs more than all that is done with it.
    """
    hearing = Hearing(node, kind, topic, profile)

    def take_all() -> None:
        for message, _ in hearing.waiting():
            take(message)

    return take_all


class _Unwoken(CallbackGroup):
    """Subscriptions whose messages wake nobody; what the middleware tells of their publishers does."""

    def can_execute(self, entity: Any) -> bool:
        """Return False for a subscription: somebody else looks after it."""
        return not isinstance(entity, Subscription)

    beginning_execution = can_execute

    def ending_execution(self, entity: Any) -> None:
        """Do nothing: nothing is held."""

"""Who else is there: whether the robot hears the commands, whether another node sends them, whether it is simulated."""

from __future__ import annotations

import time
from collections.abc import Callable

from rclpy.publisher import Publisher

from robot_ident.nodes.node import BaseNode

_SETTLE = 3.0  # s for which the listeners must stay the same: a recorder may be found so long after the robot
_TRIGGER = "std_srvs/srv/Trigger"


class Neighbours:
    """The nodes around a publisher of commands."""

    def __init__(self, node: BaseNode, commands: Callable[[], Publisher]) -> None:
        """Look at those that listen to what `commands()` publishes and publish `joint_states`."""
        self._node = node
        self._commands = commands
        self._listeners = (0, 0.0)

    def not_heard(self) -> str:
        """Return why the robot may not hear the commands yet, or an empty text."""
        topic = self._commands().topic_name
        matched = self._commands().get_subscription_count()
        if matched != self._listeners[0]:
            self._listeners = (matched, time.monotonic())
        listening = self._node.get_subscriptions_info_by_topic(topic)
        if not matched or matched < len(listening):
            return f"nobody listens to {topic}"
        settled = time.monotonic() - self._listeners[1] > _SETTLE
        return "" if settled else f"the listeners on {topic} are still being found"

    def _robots(self) -> set[tuple[str, str]]:
        """Return (name, namespace) of the nodes that listen to the commands and publish the robot's state."""
        states = self._node.get_publishers_info_by_topic(self._node.resolve_topic_name("joint_states"))
        listening = self._node.get_subscriptions_info_by_topic(self._commands().topic_name)
        named = ({(info.node_name, info.node_namespace) for info in infos} for infos in (states, listening))
        return set.intersection(*named)

    def simulated(self) -> bool:
        """Return whether what listens is a simulated robot of ours: it publishes the state and can be reset."""
        for name, namespace in self._robots():
            services = self._node.get_service_names_and_types_by_node(name, namespace)
            if (f"{namespace.rstrip('/')}/{name}/reset", [_TRIGGER]) in services:
                return True
        return False

    def rival(self) -> str:
        """Return who else commands the robot, or an empty text."""
        topic = self._commands().topic_name
        infos = self._node.get_publishers_info_by_topic(topic)
        own = (self._node.get_namespace(), self._node.get_name())
        others = [info for info in infos if (info.node_namespace, info.node_name) != own]
        if len(infos) < 2:
            return ""
        name = others[0].node_name if others else self._node.get_name()
        return f"{name} publishes on {topic} as well"

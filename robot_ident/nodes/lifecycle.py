"""A managed node: it is configured, activated, deactivated and cleaned up, by itself or by whoever manages it."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import Any

from rcl_interfaces.msg import SetParametersResult
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.lifecycle import LifecycleNodeMixin, LifecycleState, TransitionCallbackReturn
from rclpy.parameter import Parameter as RosParameter

from robot_ident.errors import RobotIdentError
from robot_ident.nodes.node import BaseNode
from robot_ident.nodes.parameters import Parameter

MANAGED = Parameter(
    "managed",
    False,
    "wait for configure and activate (ros2 lifecycle set); otherwise the node does both by itself as it starts",
)
_DONE, _REFUSED = TransitionCallbackReturn.SUCCESS, TransitionCallbackReturn.FAILURE


def transition(act: Callable[[Any], None]) -> Callable[[Any, LifecycleState], TransitionCallbackReturn]:
    """Return a transition's callback, in which a node acts: an error of ours refuses it, any other ends the node."""

    @wraps(act)
    def answer(node: ManagedNode, state: LifecycleState) -> TransitionCallbackReturn:
        try:
            act(node)
        except RobotIdentError as error:
            node.refusal = error
            if node.value(MANAGED.name):
                node.get_logger().error(str(error))
            return _REFUSED
        except BaseException as error:
            node.fail(error)
            raise
        return _DONE

    return answer


class ManagedNode(LifecycleNodeMixin, BaseNode):
    """A lifecycle node (unconfigured, inactive, active, finalized); its callbacks `on_...` are each a `transition`.

    One that can't be done leaves the node where it was and says why; where the node does its transitions itself, that
    ends it.
    """

    def __init__(self) -> None:
        """Declare the parameters; the node is unconfigured until `begin`."""
        BaseNode.__init__(self)
        # of their own: while a transition waits for rest, everything else goes on
        LifecycleNodeMixin.__init__(self, callback_group=MutuallyExclusiveCallbackGroup())
        self.refusal: RobotIdentError | None = None
        service = self._service_change_state
        service.callback = self._answering(service.callback)
        self.add_on_set_parameters_callback(self._check_changes)

    def begin(self) -> None:
        """Configure and activate, unless somebody else is to do that; what these raise passes."""
        if self.value(MANAGED.name):
            self.get_logger().info("unconfigured: waits for its lifecycle to be managed")
            return
        for step in (self.trigger_configure, self.trigger_activate):
            if step() is not _DONE:
                self.raise_failure()
                assert self.refusal is not None
                raise self.refusal

    async def come_to_rest(self) -> None:
        """Bring to rest what moves, before the node is deactivated on request."""

    @property
    def state_label(self) -> str:
        """Where in its life the node is."""
        return str(self._state_machine.current_state[1])

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """End the node."""
        if state.label == "active":
            self.on_deactivate(state)
        self.end()
        return _DONE

    def _answering(self, change: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
        """Return the answer to a request for a transition: one that isn't possible now is refused (rclpy raises)."""

        async def answer(request: Any, response: Any) -> Any:
            wanted = request.transition
            found = [
                label
                for number, label, *_ in self._state_machine.available_transitions
                if (wanted.label == label if wanted.label else wanted.id == number)
            ]
            if not found:
                self.get_logger().warning(f"{wanted.label or wanted.id}: not possible while {self.state_label}")
                response.success = False
                return response
            if found[0] in ("deactivate", "shutdown"):
                await self.come_to_rest()
            return change(request, response)

        return answer

    def _check_changes(self, changes: list[RosParameter]) -> SetParametersResult:
        """Refuse to set what `configure` has read already."""
        if self.state_label == "unconfigured":
            return SetParametersResult(successful=True)
        read = {parameter.name for parameter in self.table if parameter.until_configured}
        names = [change.name for change in changes if change.name in read]
        reason = f"parameter {names[0]} is read by configure; the node is {self.state_label}" if names else ""
        return SetParametersResult(successful=not names, reason=reason)

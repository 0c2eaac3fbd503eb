"""Publishes a recording on a topic with its own timing and its own stamps."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
import rclpy
from rclpy.context import Context
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState

from robot_ident.errors import InputError
from robot_ident.nodes.messages import joint_state
from robot_ident.nodes.node import reliable
from robot_ident.recording.recording import Recording

_DRAIN = 10.0  # s that the readers have to take in the last messages


def replay(
    recording: Recording,
    *,
    rate: float = 1.0,
    topic: str = "joint_states",
    wait: float = 30.0,
    progress: Callable[[float], None] | None = None,
) -> int:
    """Publish a recording's joint states `rate` times as fast as they were recorded; return how many.

    The header stamps are the original ones, so that who listens gets the same data. It begins when somebody listens
    (InputError after `wait` [s]; 0 begins at once) and ends when every reader has taken in the last message. `progress`
    is told the share that is done. InputError on a rate that isn't positive.
    """
    if not (rate > 0 and np.isfinite(rate)):
        raise InputError(f"rate {rate}: it must be above 0")
    stamps = recording.start_ns + np.rint(recording.t * 1e9).astype(np.int64)
    context = Context()
    rclpy.init(context=context, signal_handler_options=SignalHandlerOptions.NO)
    node: Node | None = None
    try:
        node = Node("replay", context=context, start_parameter_services=False, enable_rosout=False)
        keep_all = reliable(recording.samples)  # none dropped before it is read
        publisher = node.create_publisher(JointState, topic, keep_all)
        deadline = time.monotonic() + wait
        while wait > 0 and not publisher.get_subscription_count():
            if time.monotonic() > deadline:
                raise InputError(
                    f"nobody listens to {topic} after {wait:g} s; start the node that is to receive it first"
                )
            time.sleep(0.05)
        time.sleep(0.2)  # for further listeners that are being found at the same moment
        start = time.monotonic()
        for k in range(recording.samples):
            time.sleep(max(start + float(recording.t[k] - recording.t[0]) / rate - time.monotonic(), 0.0))
            dq = None if recording.dq is None else recording.dq[k]
            publisher.publish(joint_state(recording.names, int(stamps[k]), recording.q[k], dq, recording.tau[k]))
            if progress is not None:
                progress((k + 1) / recording.samples)
        publisher.wait_for_all_acked(Duration(seconds=_DRAIN))  # what isn't read yet dies with the publisher
        return recording.samples
    finally:
        if node is not None:
            node.destroy_node()
        context.try_shutdown()

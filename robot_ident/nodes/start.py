"""The nodes as console scripts: one clear line where ROS 2, which pip installs only on request, is missing."""

from __future__ import annotations

import importlib
import os
import signal
import sys
from functools import partial
from types import FrameType


def _start(node: str) -> int:
    """Run a node; return its exit code, 2 where it can't even be imported."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, _nothing_begun)  # until the node has handlers of its own
    try:
        main = importlib.import_module(f"robot_ident.nodes.{node}").main
    except ImportError as error:
        if (error.name or "").startswith("robot_ident."):
            raise
        sys.stderr.write(
            f"robot_ident_{node}: ROS 2 is not there, or not all of it ({error}); source it"
            " (source /opt/ros/jazzy/setup.bash) or install its wheels (pip install 'robot_ident[ros]')\n"
        )
        return 2
    return int(main())


def _nothing_begun(number: int, frame: FrameType | None) -> None:
    """End the process within its imports: nothing is there yet that could be lost."""
    os._exit(0)


trajectory_publisher = partial(_start, "trajectory_publisher")
simulated_kuka = partial(_start, "simulated_kuka")
simulated_clock = partial(_start, "simulated_clock")
recorder = partial(_start, "recorder")
estimator = partial(_start, "estimator")

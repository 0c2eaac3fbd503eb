"""Our nodes as processes of their own, for the demo."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from robot_ident.errors import RobotIdentError

_END = 10.0  # s that a node has to end after SIGINT


class NodeProcess:
    """A node, started with parameters in a DDS domain of its own; its output goes to a log file."""

    def __init__(self, node: str, parameters: dict[str, Any], domain: int, folder: Path) -> None:
        """Start the node."""
        self.node = node
        self.log = folder / f"{node}.log"
        arguments = [word for key, value in parameters.items() for word in ("-p", f"{key}:={_text(value)}")]
        environment = {
            **os.environ,
            "ROS_DOMAIN_ID": str(domain),
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
            "ROS_LOG_DIR": str(folder / "ros"),
            "OMP_NUM_THREADS": "1",
        }
        with self.log.open("wb") as log:
            self._process = subprocess.Popen(
                [sys.executable, "-m", f"robot_ident.nodes.{node}", "--ros-args", *arguments],
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                env=environment,
                start_new_session=True,
            )

    @property
    def running(self) -> bool:
        """Whether it is running."""
        return self._process.poll() is None

    def end(self) -> None:
        """Ask it to end (SIGINT) and wait; RobotIdentError when it failed."""
        if self.running:
            self._process.send_signal(signal.SIGINT)
        try:
            code = self._process.wait(_END)
        except subprocess.TimeoutExpired:
            self.kill()
            raise RobotIdentError(f"node {self.node} did not end within {_END:g} s; its log: {self.log}") from None
        if code != 0:
            raise RobotIdentError(f"node {self.node} ended with code {code}: {self._last_line()} (its log: {self.log})")

    def kill(self) -> None:
        """End it by force."""
        if self.running:
            os.killpg(self._process.pid, signal.SIGKILL)
            self._process.wait()

    def _last_line(self) -> str:
        lines = [line for line in self.log.read_text(errors="replace").splitlines() if line.strip()]
        return lines[-1] if lines else "it said nothing"


def wait_for(what: Callable[[], bool], nodes: list[NodeProcess], limit: float, tick: Callable[[], None]) -> None:
    """Wait until `what()`; RobotIdentError when a node ends first or `limit` [s] is over."""
    deadline = time.monotonic() + limit
    while not what():
        for node in nodes:
            if not node.running:
                node.end()
                raise RobotIdentError(f"node {node.node} ended too soon; its log: {node.log}")
        if time.monotonic() > deadline:
            raise RobotIdentError(f"the nodes did not finish within {limit:.0f} s; their logs: {nodes[0].log.parent}")
        tick()
        time.sleep(0.1)


def _text(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, list):
        return "[" + ", ".join(f"'{item}'" if isinstance(item, str) else str(item) for item in value) + "]"
    return str(value)

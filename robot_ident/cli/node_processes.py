"""Our nodes as processes of their own, for the demo."""

from __future__ import annotations

import fcntl
import itertools
import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, TextIO

from robot_ident.errors import RobotIdentError
from robot_ident.parallel import PARENT

_END = 60.0  # s that a node has to end after SIGINT, on a machine that hardly lets it run
_DOMAINS = 100
_PARTICIPANTS = 20
_LOCKS: list[TextIO] = []
_LOOK = 0.1  # s between two looks at what is waited for
_LONGEST_LOOK = 1.0  # s; after more than that this process has stood still itself


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
            PARENT: str(os.getpid()),
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


def free_domains(count: int) -> list[int]:
    """Return so many DDS domains in which nobody runs on this machine; RobotIdentError when there are not enough.

    Participant k of domain d listens on UDP port 7410 + 250 d + 2 k (RTPS 2.5, 9.6.2.3): where none of these is taken
    there is none. Domains up to 100 keep clear of the ports that the system hands out itself. They are this process's
    own until it ends: another that looks before any node has begun leaves them alone.
    """
    offset = os.getpid()
    in_turn = (1 + (offset + k) % _DOMAINS for k in range(_DOMAINS))
    locks = ((domain, lock) for domain in in_turn if _free(domain) and (lock := _lock(domain)) is not None)
    found = list(itertools.islice(locks, count))
    domains = [domain for domain, _ in found]
    if len(domains) < count:
        for _, lock in found:
            lock.close()
        raise RobotIdentError(
            f"{count} DDS domains are needed that no node uses; {len(domains)} of {_DOMAINS} are free"
        )
    _LOCKS.extend(lock for _, lock in found)
    return domains


def _free(domain: int) -> bool:
    """Whether the ports of a domain's first participants are free."""
    for participant in range(_PARTICIPANTS):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            try:
                probe.bind(("", 7410 + 250 * domain + 2 * participant))
            except OSError:
                return False
    return True


def _lock(domain: int) -> TextIO | None:
    """Return a lock that keeps a domain for this process, None where somebody else has it."""
    try:
        lock = (Path(tempfile.gettempdir()) / f"robot_ident_domain_{domain}.lock").open("a")
    except PermissionError:  # another user's
        return None
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        lock.close()
        return None
    return lock


def wait_for(
    what: Callable[[], bool],
    nodes: Sequence[NodeProcess],
    progress: Callable[[], Mapping[str, float]],
    patience: float,
    tick: Callable[[], None] = lambda: None,
) -> None:
    """Wait until `what()`, however long it takes while all goes on.

    RobotIdentError when a node ends first, or when one of the values of `progress()` has stayed the same for `patience`
    [s] of real time in which this process ran, too.
    """
    reached: dict[str, float] = {}
    still: dict[str, float] = {}
    before = time.monotonic()
    while not what():
        for node in nodes:
            if not node.running:
                node.end()
                raise RobotIdentError(f"node {node.node} ended too soon; its log: {node.log}")
        step, before = min(time.monotonic() - before, _LONGEST_LOOK), time.monotonic()
        for name, value in progress().items():
            still[name] = still.get(name, 0.0) + step if reached.get(name) == value else 0.0
            reached[name] = value
            if still[name] > patience:
                raise RobotIdentError(
                    f"{name} has stood still at {value:.1f} s for {patience:.0f} s; the nodes' logs:"
                    f" {nodes[0].log.parent.parent}"
                )
        tick()
        time.sleep(_LOOK)


def _text(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, list):
        return "[" + ", ".join(f"'{item}'" if isinstance(item, str) else str(item) for item in value) + "]"
    return str(value)

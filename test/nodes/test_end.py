"""Ends of nodes that come at a bad time: within a callback, or beside a thread that can't be interrupted."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from processes import LONG, environment

pytest.importorskip("rclpy")

BUSY = """
import atexit, sys, time
from robot_ident.nodes.common import Abandoned, BaseNode, run

class Busy(BaseNode):
    node_name, description, table = "busy", "never done", ()

    def __init__(self):
        super().__init__()
        Abandoned(time.sleep, (600.0,), "busy").start()
        self.every(0.2, self.end)

atexit.register(print, "taken apart")
raise SystemExit(run(Busy, ["busy"]))
"""


SIGNALLED = """
import os, signal, threading
from robot_ident.nodes.common import BaseNode, run

class Careful(BaseNode):
    node_name, description, table = "careful", "works under a lock", ()

    def __init__(self):
        super().__init__()
        self.lock = threading.Lock()
        self.every(0.2, self.work)

    def work(self):
        with self.lock:
            os.kill(os.getpid(), signal.SIGINT)
            print("worked on")

    def request_end(self, reason):
        with self.lock:
            print("asked to end by", reason)
        self.end()

raise SystemExit(run(Careful, ["careful"]))
"""


@pytest.fixture
def run_node(package: Path, tmp_path: Path, domain: int) -> Callable[[str], subprocess.CompletedProcess[str]]:
    """Return a function that runs a script to its end."""

    def run(script: str) -> subprocess.CompletedProcess[str]:
        command = [sys.executable, "-c", script]
        return subprocess.run(command, env=environment(package), capture_output=True, text=True, timeout=LONG)

    return run


def test_the_process_ends_at_once_and_whole(run_node: Callable[[str], subprocess.CompletedProcess[str]]) -> None:
    done = run_node(BUSY)
    assert done.returncode == 0, done.stderr
    assert "taken apart" not in done.stdout


def test_a_signal_is_answered_after_the_callback_in_which_it_comes(
    run_node: Callable[[str], subprocess.CompletedProcess[str]],
) -> None:
    """The ticker of the trajectory publisher may wait for what a callback holds, and the answer for the ticker."""
    done = run_node(SIGNALLED)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines() == ["worked on", "asked to end by SIGINT"]

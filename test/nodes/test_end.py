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
from robot_ident.nodes.node import Abandoned, BaseNode, run

class Busy(BaseNode):
    node_name, description, table = "busy", "never done", ()

    def __init__(self):
        super().__init__()
        Abandoned(target=time.sleep, args=(600.0,), daemon=True).start()
        self.every(0.2, self.end)

atexit.register(print, "taken apart")
raise SystemExit(run(Busy, ["busy"]))
"""


SIGNALLED = """
import os, signal, threading
from robot_ident.nodes.node import BaseNode, run

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


INTERRUPTED = """
import os, signal, subprocess
from robot_ident.nodes.node import BaseNode, run

class Named:
    def __set_name__(self, owner, name):
        os.kill(os.getpid(), signal.SIGINT)

class Destroyed:
    def __del__(self):
        os.kill(os.getpid(), signal.SIGINT)

def convert():
    # as SWIG's wrappers do: what the conversion of an argument raises is dropped for an error of their own
    try:
        os.kill(os.getpid(), signal.SIGINT)
    except BaseException:
        return NotImplementedError("Wrong number or type of arguments")

class Starting(BaseNode):
    node_name, description, table = "starting", "interrupted as it starts", ()

    def __init__(self):
        super().__init__()
        %s

    def close(self):
        print("closed")

if __name__ == "__main__":
    code = run(Starting, ["starting"])
"""
IMPORTING = """
import importlib, os, signal
from robot_ident.nodes import start

def interrupted(name):
    os.kill(os.getpid(), signal.%s)
    print("goes on")

importlib.import_module = interrupted
raise SystemExit(start.recorder())
"""
FLOODED = """
    subprocess.Popen(["sh", "-c", "exec >/dev/null 2>&1; while kill -INT $PPID; do :; done"])
    raise SystemExit(code)
"""
MADE = "exec('os.kill(os.getpid(), signal.SIGINT)')"  # as dataclasses are
WRAPPED = "type('Owner', (), {'field': Named()})"  # Python makes a RuntimeError of it, until 3.12
REPLACED = "raise convert()"
SWALLOWED = "Destroyed()"  # Python only prints what a destructor raises


@pytest.fixture
def run_node(
    package: Path, tmp_path: Path, domain: int, monkeypatch: pytest.MonkeyPatch
) -> Callable[[str], subprocess.CompletedProcess[str]]:
    """Return a function that runs a script to its end, as `python -m` does."""
    monkeypatch.syspath_prepend(tmp_path)

    def run(script: str) -> subprocess.CompletedProcess[str]:
        (tmp_path / "script.py").write_text(script)
        command = [sys.executable, "-m", "script"]
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


@pytest.mark.parametrize("interrupted", [MADE, WRAPPED, REPLACED, SWALLOWED])
def test_a_signal_during_the_start_ends_it_wherever_it_comes(
    run_node: Callable[[str], subprocess.CompletedProcess[str]], interrupted: str
) -> None:
    done = run_node(INTERRUPTED % interrupted + "    raise SystemExit(code)\n")
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines() == (["closed"] if interrupted == SWALLOWED else [])
    assert "Traceback" not in done.stderr or interrupted == SWALLOWED


@pytest.mark.parametrize("number", ["SIGINT", "SIGTERM"])
def test_a_signal_during_imports_ends_it(
    run_node: Callable[[str], subprocess.CompletedProcess[str]], number: str
) -> None:
    """As far as it is started by its name: then its own code runs before what it imports."""
    done = run_node(IMPORTING % number)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def test_signals_at_the_end_are_ignored_to_the_last(
    run_node: Callable[[str], subprocess.CompletedProcess[str]],
) -> None:
    """Python takes its own handlers away a moment before the process is gone."""
    done = run_node(INTERRUPTED % "self.end()" + FLOODED)
    assert done.returncode == 0, done.stderr

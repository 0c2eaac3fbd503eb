"""Nodes as processes of their own, and what tests of them wait for."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from robot_ident.configuration import to_yaml

LONG = 90.0  # s; whatever a test waits for comes long before, or never


class Process:
    """A node that runs."""

    def __init__(
        self,
        node: str,
        arguments: list[str],
        log: Path,
        environment: dict[str, str],
        before: Sequence[str] = (),
    ) -> None:
        self.node, self.log = node, log
        with log.open("wb") as stream:
            self.popen = subprocess.Popen(
                [*before, sys.executable, "-m", f"robot_ident.nodes.{node}", *arguments],
                stdout=stream,
                stderr=subprocess.STDOUT,
                env=environment,
                cwd=log.parent,
            )

    @property
    def text(self) -> str:
        """What it has said."""
        return self.log.read_text(errors="replace")

    def wait(self, timeout: float = LONG) -> int:
        """Wait for its end; return the exit code."""
        return self.popen.wait(timeout)

    def says(self, words: str, timeout: float = LONG) -> None:
        """Wait until it has said something."""
        wait_until(lambda: words in self.text or self.popen.poll() is not None, timeout)
        assert words in self.text, self.text

    def send(self, number: int) -> None:
        """Send it a signal."""
        self.popen.send_signal(number)

    def freeze(self, count: Callable[[], int]) -> None:
        """Stop it (SIGSTOP) in a moment after which others go on: what they send is counted.

        Stopped under a lock of the shared memory of Fast DDS, it holds up for a second whoever sends on this machine.
        """
        for _ in range(20):
            self.send(signal.SIGSTOP)
            time.sleep(0.1)
            if grows(count, 5, 0.3):
                return
            self.send(signal.SIGCONT)
            time.sleep(0.2)
        raise AssertionError("the others never went on while it stood still")

    def end(self, number: int = signal.SIGINT) -> tuple[int, float]:
        """Send it a signal; return exit code and the time that it took to end [s]."""
        self.send(number)
        begun = time.monotonic()
        return self.wait(), time.monotonic() - begun


def environment(package: Path) -> dict[str, str]:
    """Return the environment of a node that is run from this package; a crash in compiled code tells where it was."""
    return {**os.environ, "PYTHONFAULTHANDLER": "1", "PYTHONPATH": os.pathsep.join([str(package.parent), *sys.path])}


def wait_until(condition: Callable[[], Any], timeout: float = LONG) -> Any:
    """Wait until a condition holds; return its value."""
    deadline = time.monotonic() + timeout
    while not (value := condition()) and time.monotonic() < deadline:
        time.sleep(0.02)
    return value


def grows(count: Callable[[], int], by: int, timeout: float) -> bool:
    """Return whether a count grows by more than so many in time."""
    before = count()
    return bool(wait_until(lambda: count() > before + by, timeout))


def parameters(**values: object) -> list[str]:
    """Return command-line arguments that set parameters."""
    given = [f"{name}:={str(value).lower() if isinstance(value, bool) else value}" for name, value in values.items()]
    return [word for item in given for word in ("-p", item)]


def write_trajectory(path: Path, base_frequency: float = 1.0) -> Path:
    """Write a small, quick excitation within the limits of the KUKA; the slower, the wider."""
    rng = np.random.default_rng(3)
    w = 2 * np.pi * base_frequency * np.arange(1, 4)
    size = np.array([1.3, 0.7, 0.4]) / w  # rad/s, from accelerations that add up to less than 3 rad/s^2
    angle = rng.uniform(0, 2 * np.pi, (3, 3))
    data = {
        "schema": "robot_ident/excitation/1",
        "robot": "kuka_ir361",
        "joints": ["joint_1", "joint_2", "joint_3"],
        "base_frequency": base_frequency,
        "sample_rate": 150.0,
        "harmonics": 3,
        "q0": [0.0, 0.1, -0.1],
        "a": (size * np.cos(angle)).tolist(),
        "b": (size * np.sin(angle)).tolist(),
    }
    path.write_text(to_yaml(data))
    return path

"""Starts nodes as processes of their own, each test on a DDS domain of its own."""

from __future__ import annotations

import itertools
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from robot_ident.configuration import to_yaml

LONG = 40.0  # s; whatever a test waits for comes long before, or never
_numbers = itertools.count()


class Process:
    """A node that runs."""

    def __init__(self, node: str, arguments: list[str], log: Path, environment: dict[str, str]) -> None:
        self.node, self.log = node, log
        with log.open("wb") as stream:
            self.popen = subprocess.Popen(
                [sys.executable, "-m", f"robot_ident.nodes.{node}", *arguments],
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

    def end(self, number: int = signal.SIGINT) -> tuple[int, float]:
        """Send it a signal; return exit code and the time that it took to end [s]."""
        self.popen.send_signal(number)
        begun = time.monotonic()
        return self.wait(), time.monotonic() - begun


def wait_until(condition: Callable[[], Any], timeout: float = LONG) -> Any:
    """Wait until a condition holds; return its value."""
    deadline = time.monotonic() + timeout
    while not (value := condition()) and time.monotonic() < deadline:
        time.sleep(0.02)
    return value


def parameters(**values: object) -> list[str]:
    """Return command-line arguments that set parameters."""
    given = [f"{name}:={str(value).lower() if isinstance(value, bool) else value}" for name, value in values.items()]
    return [word for item in given for word in ("-p", item)]


@pytest.fixture
def domain(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> int:
    """Give the test, and what it starts, a domain of its own."""
    number = 1 + (os.getpid() * 13 + next(_numbers)) % 100
    monkeypatch.setenv("ROS_DOMAIN_ID", str(number))
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    monkeypatch.setenv("ROS_LOG_DIR", str(tmp_path / "log"))
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    return number


@pytest.fixture
def start(domain: int, tmp_path: Path, package: Path) -> Iterator[Callable[..., Process]]:
    """Return a function that starts a node with parameters; what still runs at the end is killed."""
    running: list[Process] = []

    def begin(node: str, *arguments: str, **values: object) -> Process:
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(package.parent), *sys.path])}
        process = Process(
            node,
            ["--ros-args", *arguments, *parameters(**values)],
            tmp_path / f"{len(running)}_{node}.txt",
            environment,
        )
        running.append(process)
        return process

    yield begin
    for process in running:
        if process.popen.poll() is None:
            process.popen.kill()
            process.popen.wait()


@pytest.fixture(scope="session")
def trajectory(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a small, quick excitation: 1 Hz, within the limits of the KUKA."""
    path = tmp_path_factory.mktemp("trajectory") / "excitation.yaml"
    rng = np.random.default_rng(3)
    w = 2 * np.pi * np.arange(1, 4)
    size = np.array([1.3, 0.7, 0.4]) / w  # rad/s, from accelerations that add up to less than 3 rad/s^2
    angle = rng.uniform(0, 2 * np.pi, (3, 3))
    data = {
        "schema": "robot_ident/excitation/1",
        "robot": "kuka_ir361",
        "joints": ["joint_1", "joint_2", "joint_3"],
        "base_frequency": 1.0,
        "sample_rate": 150.0,
        "harmonics": 3,
        "q0": [0.0, 0.1, -0.1],
        "a": (size * np.cos(angle)).tolist(),
        "b": (size * np.sin(angle)).tolist(),
    }
    path.write_text(to_yaml(data))
    return path


@pytest.fixture
def client(domain: int) -> Iterator[Any]:
    """Return a node in this process, spinning in a thread."""
    import rclpy
    from rclpy.context import Context
    from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
    from rclpy.signals import SignalHandlerOptions

    context = Context()
    rclpy.init(context=context, domain_id=domain, signal_handler_options=SignalHandlerOptions.NO)
    node = rclpy.create_node("test_client", context=context, start_parameter_services=False)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    ended = threading.Event()

    def spin() -> None:
        while not ended.is_set():
            try:
                executor.spin_once(timeout_sec=0.1)
            except ExternalShutdownException:
                return

    thread = threading.Thread(target=spin, daemon=True)
    thread.start()
    yield node
    ended.set()
    thread.join(5.0)
    node.destroy_node()
    context.try_shutdown()


@pytest.fixture
def call(client: Any) -> Callable[..., Any]:
    """Return a function that calls a service once it is there, and returns its answer."""

    def ask(kind: Any, name: str, request: Any = None) -> Any:
        service = client.create_client(kind, name)
        assert service.wait_for_service(timeout_sec=LONG), f"no service {name}"
        future = service.call_async(request or kind.Request())
        assert wait_until(future.done), f"no answer from {name}"
        return future.result()

    return ask


@pytest.fixture
def until() -> Callable[..., Any]:
    """Return a function that waits until a condition holds."""
    return wait_until

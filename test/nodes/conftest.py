"""Starts nodes as processes of their own, each test on a DDS domain of its own."""

from __future__ import annotations

import itertools
import os
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from processes import LONG, Process, environment, parameters, wait_until, write_trajectory

DOMAINS = 100  # whose ports don't reach into those that the system gives away
_numbers = itertools.count()


@pytest.fixture
def domain(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> int:
    """Give the test, and what it starts, a domain of its own."""
    worker, count = os.environ.get("PYTEST_XDIST_WORKER", "gw0"), os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1")
    own = DOMAINS // int(count)
    number = 1 + int(worker.removeprefix("gw")) * own + (os.getpid() * 13 + next(_numbers)) % own
    monkeypatch.setenv("ROS_DOMAIN_ID", str(number))
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    monkeypatch.setenv("ROS_LOG_DIR", str(tmp_path / "log"))
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    return number


@pytest.fixture
def start(domain: int, tmp_path: Path, package: Path) -> Iterator[Callable[..., Process]]:
    """Return a function that starts a node with parameters; what still runs at the end is killed.

    What all of them have said stands beside a test that fails.
    """
    running: list[Process] = []

    def begin(node: str, *arguments: str, **values: object) -> Process:
        process = Process(
            node,
            ["--ros-args", *arguments, *parameters(**values)],
            tmp_path / f"{len(running)}_{node}.txt",
            environment(package),
        )
        running.append(process)
        return process

    yield begin
    for process in running:
        ended = process.popen.poll()
        if ended is None:
            process.popen.kill()
            process.popen.wait()
        how = "still ran" if ended is None else f"exit code {ended}"
        sys.stdout.write(f"--- {process.node} ({how})\n{process.text}\n")


@pytest.fixture(scope="session")
def trajectory(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a small, quick excitation: 1 Hz, within the limits of the KUKA."""
    return write_trajectory(tmp_path_factory.mktemp("trajectory") / "excitation.yaml")


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
    """Return a function that calls a service once it is there, and returns its answer.

    A node drops an answer whose way back it hasn't discovered yet. Discovery tells the readers of one process in
    the order in which they were made: once the node answers a question asked later, it knows this service's too.
    """

    def ask(kind: Any, name: str, request: Any = None) -> Any:
        from rcl_interfaces.srv import GetParameters

        service = client.create_client(kind, name)
        assert service.wait_for_service(timeout_sec=LONG), f"no service {name}"
        later = client.create_client(GetParameters, f"{name.rpartition('/')[0]}/get_parameters")
        assert later.wait_for_service(timeout_sec=LONG), f"no parameters beside {name}"
        known = [later.call_async(GetParameters.Request())]
        while not wait_until(lambda: any(future.done() for future in known), 5.0):
            assert len(known) < LONG / 5.0, f"no answer beside {name}"
            known.append(later.call_async(GetParameters.Request()))
        future = service.call_async(request or kind.Request())
        assert wait_until(future.done), f"no answer from {name}"
        return future.result()

    return ask


@pytest.fixture
def put(call: Callable[..., Any]) -> Callable[[str, str, Any], Any]:
    """Return a function that sets a node's parameter and returns what came of it."""
    from rcl_interfaces.srv import SetParameters
    from rclpy.parameter import Parameter

    def give(node: str, name: str, value: Any) -> Any:
        request = SetParameters.Request(parameters=[Parameter(name, value=value).to_parameter_msg()])
        return call(SetParameters, f"{node}/set_parameters", request).results[0]

    return give


@pytest.fixture
def until() -> Callable[..., Any]:
    """Return a function that waits until a condition holds."""
    return wait_until

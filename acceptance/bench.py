"""A publisher that knows what it sent, and a recorder beside it as a process of its own."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

NAMES = tuple(f"joint_{k}" for k in range(1, 8))
LONG = 60.0  # s; what is waited for comes long before, or never


class Node:
    """A node of ours as a process of its own; what it says goes to a file."""

    def __init__(self, node: str, folder: Path, **parameters: object) -> None:
        self.node, self.log = node, folder / f"{node}.txt"
        words = [word for name, value in parameters.items() for word in ("-p", f"{name}:={value}")]
        with self.log.open("wb") as stream:
            self.popen = subprocess.Popen(
                [sys.executable, "-m", f"robot_ident.nodes.{node}", "--ros-args", *words],
                stdout=stream,
                stderr=subprocess.STDOUT,
                cwd=folder,
            )

    @property
    def text(self) -> str:
        return self.log.read_text(errors="replace")

    def end(self, number: int = signal.SIGINT) -> int:
        self.popen.send_signal(number)
        return self.popen.wait(LONG)

    def memory(self) -> float:
        """Return what it holds in memory [MB]."""
        return int(Path(f"/proc/{self.popen.pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6

    def processor(self) -> float:
        """Return the processor time that it has used [s]."""
        fields = Path(f"/proc/{self.popen.pid}/stat").read_text().rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    def kill_if_alive(self) -> None:
        if self.popen.poll() is None:
            self.popen.kill()
            self.popen.wait()


class Bench:
    """A node in this process: publishes numbered joint states at a rate, listens to the recorder's status.

    sent: send time [ns, this machine's clock] of message 1, 2, 3... Message k has position[0] = k, on each topic.
    """

    def __init__(self, rate: float, topics: Sequence[str] = ("joint_states",)) -> None:
        import rclpy
        from diagnostic_msgs.msg import DiagnosticArray
        from rclpy.context import Context
        from sensor_msgs.msg import JointState

        self.rate = rate
        self.sent: list[int] = []
        self.written = 0  # messages that the recorder has said are in its bag
        self._context = Context()
        rclpy.init(context=self._context)
        self.node = rclpy.create_node("bench", context=self._context, start_parameter_services=False)
        self._made = [self.node.create_publisher(JointState, topic, 10_000) for topic in topics]
        self.node.create_subscription(DiagnosticArray, "/recorder/status", self._on_status, 10)
        self._message = JointState(name=list(NAMES), velocity=[0.5] * 7, effort=[1.0] * 7)
        self._ended, self._paused = threading.Event(), threading.Event()
        self._threads: list[threading.Thread] = []
        self._start(self._spin)

    def _start(self, work: Any) -> None:
        self._threads.append(threading.Thread(target=work, daemon=True))
        self._threads[-1].start()

    def _spin(self) -> None:
        from rclpy.executors import SingleThreadedExecutor

        executor = SingleThreadedExecutor(context=self._context)
        executor.add_node(self.node)
        while not self._ended.is_set():
            executor.spin_once(timeout_sec=0.1)

    def _on_status(self, message: Any) -> None:
        told = {pair.key: pair.value for pair in message.status[0].values}
        self.written = max(self.written, int(told.get("messages", 0)))

    def meet(self) -> None:
        """Wait until the recorder listens."""
        wait(lambda: all(made.get_subscription_count() for made in self._made))

    def play(self) -> None:
        """Publish until the end, at the rate on average, whatever the machine's load."""
        self._start(self._publish)

    def _publish(self) -> None:
        random, begun, number = np.random.default_rng(0), time.monotonic(), 0
        while not self._paused.wait(max(begun + number / self.rate - time.monotonic(), 0.0)):
            number += 1
            self.publish(number, random.normal(size=6).tolist())

    def publish(self, number: int, noise: list[float], stamp: int = 0) -> None:
        """Send a message; its stamp [ns] is the present time unless told."""
        now = time.time_ns()
        self._message.header.stamp.sec, self._message.header.stamp.nanosec = divmod(stamp or now, 1_000_000_000)
        self._message.position = [float(number), *noise]
        self.sent.append(now)
        for made in self._made:
            made.publish(self._message)

    def pause(self) -> None:
        """Publish no more."""
        self._paused.set()

    def close(self) -> None:
        self._paused.set()
        self._ended.set()
        for thread in self._threads:
            thread.join(5.0)
        self.node.destroy_node()
        self._context.try_shutdown()


@contextmanager
def bench(
    folder: Path, rate: float, on: Sequence[str] = ("joint_states",), **parameters: object
) -> Iterator[tuple[Bench, Node]]:
    """Give a bench whose recorder listens to all of its topics, in a DDS domain of their own."""
    isolate(folder)
    further = [topic for topic in on if topic not in ("joint_states", "joint_command")]
    also = {"topics": f"[{','.join(further)}]"} if further else {}
    recorder = Node("recorder", folder, **{"status_rate": 50.0, **also, **parameters})
    made = Bench(rate, on)
    try:
        made.meet()
        yield made, recorder
    finally:
        made.close()
        recorder.kill_if_alive()


def isolate(folder: Path) -> None:
    """Keep what is started from now on among itself."""
    os.environ |= {"ROS_DOMAIN_ID": str(1 + os.getpid() % 100), "ROS_LOG_DIR": str(folder / "log")}
    os.environ |= {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST", "OMP_NUM_THREADS": "1"}


def wait(condition: Any, seconds: float = LONG) -> None:
    """Wait until a condition holds; AssertionError when it never does."""
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, "waited in vain"
        time.sleep(0.005)


def numbers_in(bag: Path) -> np.ndarray:
    """Return the numbers of the joint states in a bag, in the order in which they were written."""
    from robot_ident.bags import read_recording

    return read_recording(bag).q[:, 0].astype(int)

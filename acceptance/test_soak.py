"""Hours of running: nothing is lost, nothing grows, and how even the periods are.

Run by `make acceptance`; about an hour. An hour at 150 Hz is played in simulated time, which a `/clock` lets run
four times as fast as the real one (as fast as the machine can where that is less): 540 000 joint states and as many
commands, an hour by every stamp, with simulated robot, publisher, recorder and estimator as processes of their own.
How even the periods are is measured in real time, on a machine that has nothing else to do meanwhile: ten minutes at
500 Hz, and two at 150 Hz.
ROBOT_IDENT_SOAK: simulated seconds in place of 3600. ROBOT_IDENT_SOAK_REAL: real seconds at 500 Hz in place of 600.
"""

from __future__ import annotations

import os
import signal
import struct
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from bench import LONG, Node, isolate

pytest.importorskip("rclpy")

SIMULATED = float(os.environ.get("ROBOT_IDENT_SOAK", "3600"))
REAL = float(os.environ.get("ROBOT_IDENT_SOAK_REAL", "600"))
SPEED = 4.0
COARSE = {"rate": 50.0, "ahead": 0.04, "patience": 60.0}  # every step wakes every node; a machine may stand still
GROWTH = 1.02, 3.0  # factor and MB by which memory may differ between the second quarter and the last
SLOW = 0.01  # share by which a rate may be missed in real time, on a machine that has nothing else to do
EVEN = 1e-3  # periods by which stamps may miss their grid


def motion(folder: Path) -> Path:
    """Write a small excitation of 1 Hz, within the limits of the KUKA."""
    from robot_ident.trajectories.excitation import Excitation
    from robot_ident.trajectories.fourier_series import FourierSeries

    random, w = np.random.default_rng(3), 2 * np.pi * np.arange(1, 4)
    size, angle = np.array([1.3, 0.7, 0.4]) / w, random.uniform(0, 2 * np.pi, (3, 3))
    series = FourierSeries(1.0, np.array([0.0, 0.1, -0.1]), size * np.cos(angle), size * np.sin(angle))
    path = folder / "excitation.yaml"
    Excitation("kuka_ir361", ("joint_1", "joint_2", "joint_3"), series, 150.0).write(path)
    return path


class Watch:
    """Memory and processor time of some nodes, looked at once a second."""

    def __init__(self, nodes: list[Node]) -> None:
        self.nodes = nodes
        self.begun = time.monotonic()
        self.memory: dict[str, list[float]] = {node.node: [] for node in nodes}
        self.processor: dict[str, float] = {}

    def look(self) -> None:
        for node in self.nodes:
            if node.popen.poll() is None:
                self.memory[node.node].append(node.memory())
                self.processor[node.node] = node.processor()

    def report(self) -> None:
        """Print what each node took; AssertionError where memory grows."""
        seconds, grown = time.monotonic() - self.begun, []
        for node, memory in self.memory.items():
            quarter = len(memory) // 4
            early, late = max(memory[quarter : 2 * quarter]), max(memory[3 * quarter :])
            share = 100 * self.processor[node] / seconds
            print(f"  {node:<21} {share:5.1f} % of a processor; memory {early:.1f} MB, at the end {late:.1f} MB")
            if late > GROWTH[0] * early + GROWTH[1]:
                grown.append(f"{node}: {early:.1f} to {late:.1f} MB")
        assert not grown, grown


@contextmanager
def running(folder: Path, *nodes: tuple[str, dict[str, object]]) -> Iterator[list[Node]]:
    """Start nodes in a DDS domain of their own; those that still run at the end are killed."""
    isolate(folder)
    started = [Node(name, folder, **parameters) for name, parameters in nodes]
    try:
        yield started
    finally:
        for node in started:
            node.kill_if_alive()


def play(folder: Path, seconds: float, rate: float, speed: float | None) -> Watch:
    """Play the motion for so many seconds by the robot's clock, and record it; speed: of simulated time."""
    simulated = {"use_sim_time": "true"} if speed else {}
    excitation = str(motion(folder))
    nodes: list[tuple[str, dict[str, object]]] = [
        ("recorder", {"output": folder / "bag"}),
        ("simulated_kuka", {"rate": rate, **simulated}),
        ("estimator", {"trajectory": excitation, "memory": seconds / 12, "automatic": "false", **simulated}),
    ]
    if speed:
        nodes.append(("simulated_clock", {"speed": speed, **COARSE}))
    last = {"trajectory": excitation, "periods": round(seconds), "rate": rate, "autostart": "true"}
    # a loaded machine is to show in the periods, not to end the run
    patient = {"state_timeout": 10.0, "stall": 10.0, "tracking_error": "[10.0]", "effort_limit": 0.0}
    nodes.append(("trajectory_publisher", {**last, **patient, "exit_when_done": "true", **simulated}))
    with running(folder, *nodes) as started:
        watch, publisher = Watch(started), started[-1]
        deadline = time.monotonic() + 5 * seconds + 2 * LONG
        while publisher.popen.poll() is None:
            assert time.monotonic() < deadline, "the motion does not come to its end"
            for node in started[:-1]:
                assert node.popen.poll() is None, node.text
            if "playing" in publisher.text:  # what is taken at the start is not growth
                watch.look()
            time.sleep(1.0)
        assert publisher.popen.returncode == 0, publisher.text
        assert started[0].end(signal.SIGINT) == 0, started[0].text
    return watch


def messages_of(bag: Path, topic: str) -> np.ndarray:
    """Return sequence number, header stamp, send and receive time [ns] of each message [N, 4], by the mcap library."""
    from mcap.reader import make_reader

    rows = []
    for file in sorted(bag.glob("*.mcap")):
        with file.open("rb") as stream:
            for _, _, message in make_reader(stream).iter_messages([topic], log_time_order=False):
                seconds, nanoseconds = struct.unpack_from("<iI", message.data, 4)
                stamp = seconds * 1_000_000_000 + nanoseconds
                rows.append((message.sequence, stamp, message.publish_time, message.log_time))
    return np.array(rows, dtype=np.int64)


def nothing_lost(bag: Path, topic: str, rate: float, least: float) -> np.ndarray:
    """Assert that the senders' numbers leave none out and that stamps are whole periods apart; return the rows."""
    rows = messages_of(bag, topic)
    lost = np.diff(rows[:, 0]) - 1
    assert not lost.any(), f"{topic}: {int(lost.sum())} messages are missing in {int((lost != 0).sum())} places"
    assert len(rows) >= least
    steps = np.diff(rows[:, 1]) * rate / 1e9
    periods = np.rint(steps)
    print(f"  {topic:<21} {len(rows)} messages, none missing, {int((periods != 1).sum())} uneven stamps")
    worst = float(np.abs(steps - periods).max())
    assert worst < EVEN, f"{topic}: a stamp is {worst:.3f} periods off the grid of those before it"
    return rows


def reached(rows: np.ndarray, topic: str, rate: float, missed: float) -> None:
    """Assert that the rate was reached, and that at most a share `missed` of the periods has no stamp."""
    periods = np.rint(np.diff(rows[:, 1]) * rate / 1e9)
    left_out = periods.sum() / len(periods) - 1.0
    assert left_out <= missed, f"{topic}: {left_out:.2%} of the periods have no stamp; was the machine busy?"
    sent = 1e9 * (len(rows) - 1) / (rows[-1, 2] - rows[0, 2])
    print(f"    sent at {sent:.1f} Hz on average")
    assert abs(sent / rate - 1.0) < SLOW, f"{topic}: sent at {sent:.1f} Hz; was the machine busy?"


def test_an_hour_at_150_hz(tmp_path: Path) -> None:
    watch = play(tmp_path, SIMULATED, 150.0, SPEED)
    print(f"\n{SIMULATED:g} s of simulated time at 150 Hz, in {time.monotonic() - watch.begun:.0f} s")
    for topic in ("/joint_states", "/joint_command"):
        rows = nothing_lost(tmp_path / "bag", topic, 150.0, 150 * SIMULATED)
        steps = np.rint(np.diff(rows[:, 1]) * 150.0 / 1e9)
        assert (steps == 1).all(), f"{topic}: a loaded machine slows simulated time and leaves nothing out"
    watch.report()


@pytest.mark.parametrize(("rate", "share"), [(150.0, 0.2), (500.0, 1.0)])
def test_periods_in_real_time(tmp_path: Path, rate: float, share: float) -> None:
    """The rate asked for is reached: the robot reports every sample, and hardly a command is left out."""
    seconds = share * REAL
    watch = play(tmp_path, seconds, rate, None)
    print(f"\n{seconds:g} s of real time at {rate:g} Hz")
    sent = {}
    for topic in ("/joint_states", "/joint_command"):
        rows = sent[topic] = nothing_lost(tmp_path / "bag", topic, rate, 0.5 * rate * seconds)
        for what, column in (("sent", 2), ("received", 3)):
            period = np.diff(rows[:, column]) / 1e3
            middle, rare = np.percentile(np.abs(period - 1e6 / rate), [50.0, 99.9])
            print(
                f"    period as {what}: off by {middle:.0f} us (median), {rare:.0f} us (99.9 %), of {1e6 / rate:.0f} us"
            )
    watch.report()
    reached(sent["/joint_states"], "/joint_states", rate, 0.0)
    reached(sent["/joint_command"], "/joint_command", rate, SLOW)

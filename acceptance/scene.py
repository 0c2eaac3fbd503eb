"""A robot that plays while something goes wrong: real processes over real DDS, and this process in between.

Time comes from here, or from the node `simulated_clock`, and waits for robot and publisher, so that a loaded machine
slows the scene and disturbs nothing.
The simulated robot publishes on `raw_states`; a relay here hands that on to `joint_states`, and is where faults of the
robot are put in. What this process hears is noted, so that it can be asked for in the bag afterwards.
"""

from __future__ import annotations

import re
import threading
import time
from collections.abc import Callable
from copy import deepcopy
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from commanded import commands
from processes import Process, environment, parameters, wait_until, write_trajectory

import robot_ident
from robot_ident.bags import read_messages, read_recording
from robot_ident.playback.stamps import header_stamp
from robot_ident.robot import load_robot

LOADED = 90.0  # s; what a heavily loaded machine may take for anything
PACKAGE = Path(robot_ident.__file__).resolve().parent
STATES, COMMANDS, RAW = "/joint_states", "/joint_command", "raw"
PATIENT = {"state_timeout": 1.0, "tracking_error": "[0.15]", "state_wait": LOADED}
_STEP = 0.003  # s between two /clock messages
_AHEAD_NS = 20_000_000
_GAP = 0.5  # s; commands further apart are not judged against each other


@dataclass
class Scene:
    """What runs, what is done to the robot's states on their way, and what was heard."""

    folder: Path
    node: Any
    awaited: set[str] = field(default_factory=lambda: {RAW, COMMANDS})
    change: Callable[[Any], list[Any]] = lambda message: [message]
    processes: list[Process] = field(default_factory=list)
    heard: dict[str, list[int]] = field(default_factory=lambda: {STATES: [], COMMANDS: []})
    now_ns: int = field(default_factory=time.time_ns)
    _jump_ns: int = 0
    _before: dict[str, list[int]] = field(default_factory=dict)
    _newest: dict[str, int] = field(default_factory=dict)
    _ended: threading.Event = field(default_factory=threading.Event)

    def start(self, name: str, *arguments: str, before: tuple[str, ...] = (), **values: object) -> Process:
        """Start a node."""
        given = {"use_sim_time": True, **values}
        log = self.folder / f"{len(self.processes)}_{name}.txt"
        words = ["--ros-args", *arguments, *parameters(**given)]
        process = Process(name, words, log, environment(PACKAGE), before)
        self.processes.append(process)
        return process

    def play(self, *, clock_node: bool = False, **values: object) -> tuple[Process, Process, Process]:
        """Start recorder, robot and publisher; return them once the robot has played for a while.

        clock_node: time is that of `simulated_clock`, the first of `processes`.
        """
        if clock_node:
            self.start("simulated_clock", use_sim_time=False)
        self._listen(follows=clock_node)
        recorder = self.start("recorder", output=self.folder / "bag")
        robot = self.start("simulated_kuka", "-r", "joint_states:=raw_states", delay=0.15, noise=0.0)
        recorder.says("recording to", LOADED)
        publisher = self.start("trajectory_publisher", **{**self.motion(), "controller": "simulated_kuka", **values})
        publisher.says("playing", LOADED)
        self.moves(300)
        return recorder, robot, publisher

    def motion(self) -> dict[str, object]:
        """Return the parameters of the publisher: a long motion, and patience."""
        path = write_trajectory(self.folder / "excitation.yaml", 0.3)
        return {"trajectory": path, "periods": 200, "autostart": True, **PATIENT}

    def moves(self, count: int) -> None:
        """Wait until so many further commands have come."""
        goal = len(self.heard[COMMANDS]) + count
        assert wait_until(lambda: len(self.heard[COMMANDS]) > goal, LOADED), self.texts()

    def _listen(self, follows: bool) -> None:
        from rclpy.qos import QoSProfile
        from rosgraph_msgs.msg import Clock
        from sensor_msgs.msg import JointState

        many = QoSProfile(depth=5000)
        states = self.node.create_publisher(JointState, "joint_states", many)

        def relay(message: Any) -> None:
            self._newest[RAW] = stamp(message)
            for changed in self.change(deepcopy(message)):
                self.heard[STATES].append(stamp(changed))
                states.publish(changed)

        self.node.create_subscription(JointState, "raw_states", relay, many)

        def hear(message: Any) -> None:
            self._newest[COMMANDS] = stamp(message)
            self.heard[COMMANDS].append(stamp(message))

        self.node.create_subscription(JointState, "joint_command", hear, many)
        if follows:
            self.node.create_subscription(Clock, "/clock", self._hear_clock, 10)
            return
        clock = self.node.create_publisher(Clock, "/clock", 10)
        threading.Thread(target=self._run_clock, args=(clock,), daemon=True).start()

    def _hear_clock(self, message: Any) -> None:
        self.now_ns = int(message.clock.sec) * 1_000_000_000 + int(message.clock.nanosec)

    def _run_clock(self, clock: Any) -> None:
        """Publish time no faster than real time, and no faster than those who are `awaited` can follow."""
        from rosgraph_msgs.msg import Clock

        from robot_ident.nodes.messages import time_message

        while not self._ended.wait(_STEP):
            late = any(self._newest.get(name, self.now_ns) < self.now_ns - _AHEAD_NS for name in self.awaited)
            if self._jump_ns or not late:
                self.now_ns += round(1e9 * _STEP) + self._jump_ns
                self._jump_ns = 0
                clock.publish(Clock(clock=time_message(self.now_ns)))

    def fault(self) -> tuple[int, int]:
        """Return the machine's time and that of `/clock` [ns]; what was heard until now must be in the bag."""
        self._before = {topic: list(stamps) for topic, stamps in self.heard.items()}
        return time.time_ns(), self.now_ns

    def heard_before(self, topic: str) -> list[int]:
        """Return the stamps that were heard before the fault."""
        return self._before[topic]

    def jump(self, seconds: float) -> None:
        """Let `/clock` jump."""
        self._jump_ns = round(1e9 * seconds)

    def texts(self) -> str:
        """Return what all have said."""
        return "\n".join(f"--- {process.node}\n{process.text}" for process in self.processes)

    def close(self) -> None:
        """End what still runs."""
        self._ended.set()
        for process in self.processes:
            if process.popen.poll() is None:
                process.popen.kill()
                process.popen.wait()


def stamp(message: Any) -> int:
    """Return the header's stamp [ns]."""
    return int(message.header.stamp.sec) * 1_000_000_000 + int(message.header.stamp.nanosec)


def settled(value: Callable[[], int]) -> int:
    """Wait until a value stays the same for two seconds, beside whatever else runs; return it."""
    deadline = time.monotonic() + LOADED
    while time.monotonic() < deadline:
        before = value()
        time.sleep(2.0)
        if value() == before:
            return before
    raise AssertionError("it never came to rest")


def lost_on_the_way(scene: Scene) -> int:
    """Return how many commands the recorder says that it has missed."""
    text = " ".join((scene.folder / "bag" / "metadata.yaml").read_text().split())
    found = re.search(r"robot_ident/joint_command: '?[^,]*, (\d+) lost on the way", text)
    assert found, text
    return int(found[1])


def not_recorded(scene: Scene) -> int:
    """Return how many commands were heard here, and are not in the bag."""
    there = {header_stamp(message.data) for message in read_messages(scene.folder / "bag", [COMMANDS])}
    heard = scene.heard[COMMANDS]
    return sum(one not in there for one in heard[heard.index(min(there)) :])


def records_again(scene: Scene, since_ns: int) -> bool:
    """Return whether commands later than an instant reach the bag: DDS needs seconds to tell what is lost for good."""
    time.sleep(0.5)
    return any(header_stamp(message.data) > since_ns for message in read_messages(scene.folder / "bag", [COMMANDS]))


def missing_states(bag: Path, robot: Any) -> int:
    """Return how many of the robot's states never came to the computer: a reliable topic sends them again."""
    stamps = {round(1e6 * (robot.start_ns * 1e-9 + t)) for t in robot.t}
    known = read_recording(bag)
    came = {round(1e6 * (known.start_ns * 1e-9 + t)) for t in known.t}
    between = {one for one in stamps if min(came) <= one <= max(came)}
    return len(between - came)


@dataclass(frozen=True)
class Outcome:
    """Seconds of real time until the node said why, seconds of `/clock` until the last command that moves; acceleration
    as a share of its limit; messages in the bag, and missing of those that were heard before the fault.
    """

    told: float
    rest: float
    acceleration: float
    kept: int
    missing: int


def told_after(process: Process, words: str, since_ns: int) -> float:
    """Return how long after an instant [ns] of the machine's clock a node has said something [s]."""
    line = next(line for line in process.text.splitlines() if words in line)
    found = re.search(r"\[(\d+\.\d+)\]", line)
    assert found, line
    return float(found[1]) - since_ns * 1e-9


def outcome(bag: Path, scene: Scene, fault_ns: int, told: float) -> Outcome:
    """Return what a bag shows of a fault at an instant [ns] of `/clock`, and what of the time before it lacks."""
    t, q, dq = commands(bag)
    limits = load_robot().limits
    dt = np.diff(t)
    good = dt > 0.0  # a clock that jumps back
    share = np.abs(np.diff(dq, axis=0))[good] / dt[good, None] / limits.acceleration
    leap = np.abs(np.diff(q, axis=0) - 0.5 * (dq[1:] + dq[:-1]) * dt[:, None])
    allowed = 0.1 * limits.acceleration * dt[:, None] ** 2 + 1e-6  # what a curve leaves a trapezium
    allowed[~good | (dt > _GAP)] = np.inf  # where a recorder that stood still has missed what was between
    steps = np.flatnonzero((leap > allowed).any(axis=1))
    assert not steps.size, f"the commanded position steps by {leap[steps].max():.4f} rad"
    assert np.all(np.abs(dq) < limits.velocity)
    stamps = [header_stamp(message.data) for message in read_messages(bag, [COMMANDS])]
    moving = np.flatnonzero(np.abs(dq).max(axis=1) > 1e-9)
    kept = missing = 0
    for topic in (STATES, COMMANDS):
        recorded = [header_stamp(message.data) for message in read_messages(bag, [topic])]
        asked, there = scene.heard_before(topic), set(recorded)
        since = asked.index(recorded[0]) if recorded and recorded[0] in there.intersection(asked) else 0
        kept += len(recorded)
        missing += sum(one not in there for one in asked[since:])
    return Outcome(told, (stamps[moving[-1]] - fault_ns) * 1e-9, float(share.max()), kept, missing)


class Table:
    """The rows of the fault table."""

    def __init__(self) -> None:
        self.rows: list[tuple[str, str, Outcome]] = []

    def add(self, fault: str, must: str, found: Outcome) -> None:
        """Add a row, and print it at once: a run may be cut short."""
        self.rows.append((fault, must, found))
        print(f"\n  {self._line(fault, must, found)}")

    @staticmethod
    def _line(fault: str, must: str, o: Outcome) -> str:
        told = f"{o.told:6.2f} s" if np.isfinite(o.told) else "       -"
        rest = f"{o.rest:6.2f} s" if np.isfinite(o.rest) else "       -"
        return f"{fault:<34} {must:<38} {told} {rest} {o.acceleration:9.3f} {o.kept:9d} {o.missing:5d}"

    def print(self) -> None:
        """Print the table."""
        head = f"{'fault':<34} {'what must happen':<38} {'told':>8} {'at rest':>8} {'largest':>9}"
        print(f"\n{head} {'in bag':>9} {'lost':>5}\n{'':<34} {'':<38} {'after':>8} {'after':>8} {'a/limit':>9}")
        for row in self.rows:
            print(self._line(*row))

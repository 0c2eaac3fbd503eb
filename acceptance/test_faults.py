"""Everything that may go wrong while a robot is moved, injected for real: what happens, how fast, how hard.

Real processes over real DDS; `told` is real time and grows with the machine's load, `at rest` is time of `/clock`.
"""

from __future__ import annotations

import math
import os
import signal
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from network import Cable, available
from processes import wait_until
from scene import (
    COMMANDS,
    LOADED,
    Outcome,
    Scene,
    Table,
    lost_on_the_way,
    missing_states,
    not_recorded,
    outcome,
    records_again,
    settled,
    stamp,
    told_after,
)

from robot_ident.bags import read_messages, read_recording

pytest.importorskip("rclpy")

PAUSE = 3.0  # s of /clock for which a process is stopped, and of real time for which the network is cut
MOVES = 0.02  # rad/s; an encoder's step shows as less
LOOSE = {"tracking_error": "[1.0]"}  # or the last position heard is far away before the silence is
HARDEST = 1.02  # of the acceleration limit: what stamps rounded to a nanosecond and 7 ms steps leave uncertain


@pytest.fixture(scope="module")
def table() -> Iterator[Table]:
    made = Table()
    yield made
    made.print()


@pytest.fixture
def node(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, request: pytest.FixtureRequest) -> Iterator[Any]:
    """A node in this process, spinning in a thread, on a domain of the test's own."""
    import threading

    import rclpy
    from rclpy.context import Context
    from rclpy.executors import SingleThreadedExecutor
    from rclpy.signals import SignalHandlerOptions

    number = 1 + (os.getpid() * 7 + hash(request.node.name)) % 100
    monkeypatch.setenv("ROS_DOMAIN_ID", str(number))
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    monkeypatch.setenv("ROS_LOG_DIR", str(tmp_path / "log"))
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    context = Context()
    rclpy.init(context=context, domain_id=number, signal_handler_options=SignalHandlerOptions.NO)
    made = rclpy.create_node("fault_injector", context=context, start_parameter_services=False)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(made)
    ended = threading.Event()

    def spin() -> None:
        while not ended.is_set():
            executor.spin_once(timeout_sec=0.1)

    thread = threading.Thread(target=spin, daemon=True)
    thread.start()
    yield made
    ended.set()
    thread.join(5.0)
    made.destroy_node()
    context.try_shutdown()


@pytest.fixture
def scene(node: Any, tmp_path: Path) -> Iterator[Scene]:
    made = Scene(tmp_path, node)
    yield made
    made.close()


def closed(scene: Scene, recorder: Any, fault_ns: int, told: float) -> Outcome:
    """End the recorder and look into its bag; the largest acceleration is within its limit, nothing is lost."""
    assert recorder.end()[0] == 0, recorder.text
    found = outcome(scene.folder / "bag", scene, fault_ns, told)
    assert found.acceleration < HARDEST, found
    assert found.missing == 0, "received before the fault, and not in the bag"
    return found


# --- the robot's states


def silent(message: Any) -> list[Any]:
    return []


def not_a_number(message: Any) -> list[Any]:
    message.position[1] = math.nan
    return [message]


class Frozen:
    """The first positions again and again, with stamps that go on: a sensor that hangs."""

    def __init__(self) -> None:
        self.position: Any = None

    def __call__(self, message: Any) -> list[Any]:
        self.position = self.position if self.position is not None else message.position
        message.position = self.position
        return [message]


def mislabelled(message: Any) -> list[Any]:
    message.name = [message.name[k] for k in (2, 0, 1)]
    return [message]


class Spike:
    """One message in which the effort of joint 1 is ten times its limit."""

    def __init__(self) -> None:
        self.done = False

    def __call__(self, message: Any) -> list[Any]:
        if not self.done:
            message.effort[0] = 3930.0
        self.done = True
        return [message]


STOPS: list[tuple[str, Callable[[], Callable[[Any], list[Any]]], str]] = [
    ("robot silent", lambda: silent, "no new joint_states for"),
    ("NaN in a position", lambda: not_a_number, "the position of joint_2 is nan"),
    ("frozen positions", Frozen, "from where it was sent"),
    ("positions under wrong names", lambda: mislabelled, "from where it was sent"),
    ("effort spike in one message", Spike, "the effort of joint_1 is 3930.0"),
]


@pytest.mark.parametrize(("fault", "make", "says"), STOPS, ids=[row[0].replace(" ", "_") for row in STOPS])
def test_a_fault_of_the_robot_stops(
    fault: str, make: Callable[[], Callable[[Any], list[Any]]], says: str, scene: Scene, table: Table
) -> None:
    recorder, _, publisher = scene.play(**LOOSE if make() is silent else {})
    change = make()
    begun, fault_ns = scene.fault()
    scene.change = change
    publisher.says("stopping: ", LOADED)
    assert wait_until(lambda: "holding: " in publisher.text or "halted: " in publisher.text, LOADED), publisher.text
    assert says in publisher.text
    found = closed(scene, recorder, fault_ns, told_after(publisher, "stopping: ", begun))
    assert publisher.end()[0] == 0
    table.add(fault, "smooth stop, says why", found)


def permuted(message: Any) -> list[Any]:
    order = (2, 0, 1)
    for name in ("name", "position", "velocity", "effort"):
        values = getattr(message, name)
        setattr(message, name, [values[k] for k in order])
    return [message]


def with_gripper(message: Any) -> list[Any]:
    """Two more joints in the arm's message, and a gripper with messages of its own."""
    from sensor_msgs.msg import JointState

    gripper = JointState(name=["finger"], position=[9.0], velocity=[0.0], effort=[0.0])
    gripper.header.stamp = message.header.stamp
    message.name = ["rail", *message.name, "wrist"]
    for name in ("position", "velocity", "effort"):
        setattr(message, name, [7.0, *getattr(message, name), -7.0])
    return [message, gripper]


@pytest.mark.parametrize(("fault", "change"), [("joints in another order", permuted), ("extra joints", with_gripper)])
def test_what_is_no_fault_goes_on(fault: str, change: Callable[[Any], list[Any]], scene: Scene, table: Table) -> None:
    recorder, _, publisher = scene.play()
    _, fault_ns = scene.fault()
    scene.change = change
    scene.moves(600)
    assert "stopping" not in publisher.text, publisher.text
    publisher.end()
    found = closed(scene, recorder, fault_ns, math.nan)
    table.add(fault, "goes on (joints by name)", Outcome(math.nan, math.nan, *_rest(found)))


def _rest(found: Outcome) -> tuple[float, int, int]:
    return found.acceleration, found.kept, found.missing


def test_a_robot_that_is_elsewhere(scene: Scene, table: Table) -> None:
    """The plant itself is put back to its start while it moves."""
    from std_srvs.srv import Trigger

    recorder, _, publisher = scene.play(tracking_error="[0.15]")
    reset = scene.node.create_client(Trigger, "/simulated_kuka/reset")
    assert reset.wait_for_service(timeout_sec=LOADED)
    begun, fault_ns = scene.fault()
    future = reset.call_async(Trigger.Request())
    publisher.says("from where it was sent (bound 0.15)", LOADED)
    publisher.says("halted: ", LOADED)
    assert future.done()
    table.add(
        "tracking error",
        "smooth stop, says why",
        closed(scene, recorder, fault_ns, told_after(publisher, "stopping: ", begun)),
    )


# --- processes


def test_a_killed_publisher(scene: Scene, table: Table) -> None:
    recorder, robot, publisher = scene.play()
    velocities: list[tuple[int, Any]] = []

    def note(message: Any) -> list[Any]:
        velocities.append((stamp(message), np.array(message.velocity)))
        return [message]

    scene.change = note
    assert wait_until(lambda: any(np.abs(v).max() > 0.3 for _, v in velocities[-3:]), LOADED), "it moves"
    _, fault_ns = scene.fault()
    scene.awaited.discard(COMMANDS)
    publisher.end(signal.SIGKILL)
    assert wait_until(lambda: all(np.abs(v).max() < MOVES for _, v in velocities[-75:]), LOADED), "it holds"
    moved = [at for at, v in velocities if np.abs(v).max() > MOVES]
    v = np.array([one for _, one in velocities])
    braking = np.abs(np.diff(v, axis=0)).max() * 150.0 / 3.0
    found = closed(scene, recorder, fault_ns, math.nan)
    assert "messages (" in recorder.text.splitlines()[-1], "the bag is closed properly"
    assert braking < 1.3, "the robot brakes within its limit, apart from the ringing of its servo"
    table.add("publisher killed (-9)", "robot brakes and holds, bag closed", Outcome(
        math.nan, (moved[-1] - fault_ns) * 1e-9, max(found.acceleration, braking), found.kept, found.missing
    ))  # fmt: skip


PAUSED: list[tuple[str, str, str]] = [
    ("trajectory_publisher", "halted: this process stood still", "commands nothing more; robot holds"),
    ("simulated_kuka", "no new joint_states for", "smooth stop, says why"),
    ("recorder", "", "goes on; counts what is lost"),
    ("estimator", "", "goes on"),
]


@pytest.mark.parametrize(("name", "says", "must"), PAUSED, ids=[row[0] for row in PAUSED])
def test_a_node_that_stands_still(name: str, says: str, must: str, scene: Scene, table: Table) -> None:
    recorder, _, publisher = scene.play(**LOOSE if name == "simulated_kuka" else {})
    if name == "estimator":
        scene.start(name, base_frequency=0.3).says("", LOADED)
        scene.moves(300)
    victim = next(process for process in scene.processes if process.node == name)
    begun, fault_ns = scene.fault()
    if says:
        scene.awaited.clear()  # time goes on without it
    victim.send(signal.SIGSTOP)
    assert wait_until(lambda: scene.now_ns > fault_ns + PAUSE * 1e9, LOADED)
    victim.send(signal.SIGCONT)
    if not says:
        since_ns = scene.now_ns
        scene.moves(600)
        if name == "recorder":
            assert wait_until(lambda: records_again(scene, since_ns), LOADED), "it hears commands again"
        assert "stopping" not in publisher.text and victim.popen.poll() is None
        publisher.end()
        found = closed(scene, recorder, fault_ns, math.nan)
        if name == "recorder":
            assert lost_on_the_way(scene) == not_recorded(scene) > 0, "what it missed is counted in the bag"
        table.add(f"{name} stopped for 3 s", must, Outcome(math.nan, math.nan, *_rest(found)))
        return
    publisher.says(says, LOADED)
    assert wait_until(lambda: "halted" in publisher.text or "holding" in publisher.text, LOADED), publisher.text
    told = told_after(publisher, says, begun)
    assert publisher.end()[0] == 0
    table.add(f"{name} stopped for 3 s", must, closed(scene, recorder, fault_ns, told))


def test_a_clock_that_stands_still(scene: Scene, table: Table) -> None:
    """Time itself is stopped: nobody moves, nobody takes the silence for a fault, and all go on where they were."""
    recorder, _, publisher = scene.play(clock_node=True)
    clock = scene.processes[0]
    _, fault_ns = scene.fault()
    clock.send(signal.SIGSTOP)
    stopped_ns = settled(lambda: scene.now_ns)
    heard = settled(lambda: len(scene.heard[COMMANDS]))
    time.sleep(PAUSE)  # the fault itself: it lasts so long
    assert scene.now_ns == stopped_ns and len(scene.heard[COMMANDS]) == heard, "time stands still"
    clock.send(signal.SIGCONT)
    scene.moves(600)
    assert "stopping" not in publisher.text and "halted" not in publisher.text, publisher.text
    steps = np.diff([one for one in scene.heard[COMMANDS] if one > fault_ns])
    assert steps.max() < 1.5e9 / 150.0, "no command is left out"
    publisher.end()
    found = closed(scene, recorder, fault_ns, math.nan)
    table.add("simulated_clock stopped for 3 s", "all wait, then go on", Outcome(math.nan, math.nan, *_rest(found)))


# --- time, rivals, network


@pytest.mark.parametrize("jump", [5, -5])
def test_a_clock_that_jumps(jump: int, scene: Scene, table: Table) -> None:
    recorder, _, publisher = scene.play()
    _, fault_ns = scene.fault()
    scene.jump(jump)
    publisher.says("stopping: the clock jumped by", LOADED)
    assert wait_until(lambda: "holding: " in publisher.text or "halted: " in publisher.text, LOADED), publisher.text
    found = closed(scene, recorder, fault_ns + jump * 1_000_000_000, math.nan)
    table.add(f"/clock jumps by {jump:+d} s", "smooth stop, says why", found)


def test_two_publishers(scene: Scene, table: Table) -> None:
    from sensor_msgs.msg import JointState

    recorder, _, publisher = scene.play()
    begun, fault_ns = scene.fault()
    rival = scene.node.create_publisher(JointState, "joint_command", 10)
    publisher.says("fault_injector publishes on /joint_command as well", LOADED)
    publisher.says("holding: fault_injector", LOADED)
    scene.node.destroy_publisher(rival)
    found = closed(scene, recorder, fault_ns, told_after(publisher, "stopping: ", begun))
    table.add("two publishers", "smooth stop, says why", found)


@pytest.fixture
def cable() -> Iterator[Cable]:
    if not available():
        pytest.skip("network namespaces can't be made here (root is needed)")
    made = Cable()
    yield made
    made.close()


def test_a_network_that_is_cut(cable: Cable, scene: Scene, table: Table, tmp_path: Path) -> None:
    """Robot and computer apart, over UDP; real time, since no clock could be heard on both sides."""
    at_robot, at_computer = cable.inside(cable.robot), cable.inside(cable.computer)
    real = {"use_sim_time": False}
    there = scene.start("recorder", before=at_robot, output=tmp_path / "there", **real)
    here = scene.start("recorder", before=at_computer, output=tmp_path / "bag", **real)
    scene.start("simulated_kuka", before=at_robot, delay=0.15, noise=0.0, **real)
    for recorder in (there, here):
        recorder.says("recording to", LOADED)
    publisher = scene.start(
        "trajectory_publisher", before=at_computer, **{**scene.motion(), **LOOSE, "stall": 1.0, **real}
    )
    publisher.says("playing", LOADED)
    bags = [tmp_path / "there", tmp_path / "bag"]
    grown(bags[0], 300_000)
    fault_ns, _ = scene.fault()
    cable.pull()
    time.sleep(PAUSE)  # the fault itself: it lasts so long
    cable.plug()
    mended_ns = time.time_ns()
    publisher.says("stopping: no new joint_states for", LOADED)
    publisher.says("halted: ", LOADED)
    grown(bags[1], 300_000)  # the robot is heard again
    told = told_after(publisher, "stopping: ", fault_ns)
    assert publisher.end()[0] == 0 and there.end()[0] == 0
    found = closed(scene, here, fault_ns, told)
    late = [message for message in read_messages(bags[0], [COMMANDS]) if message.log_time > mended_ns]
    assert not late, "no command of the past reaches the robot once the network is back"
    states = read_recording(bags[0])
    assert states.dq is not None
    assert np.abs(states.dq[-75:]).max() < MOVES, "the robot holds by itself"
    after = states.t > fault_ns * 1e-9 - states.start_ns * 1e-9
    t, dq = states.t[after], states.dq[after]
    braking = float((np.abs(np.diff(dq, axis=0)) / np.diff(t)[:, None]).max() / 3.0)
    assert braking < 1.3, "and has braked within its limits, apart from the ringing of its servo"
    rest = float(t[np.abs(dq).max(axis=1) > MOVES][-1] - fault_ns * 1e-9 + states.start_ns * 1e-9)
    table.add("network cut for 3 s", "smooth stop; what is late is dropped", found)
    lost = missing_states(bags[1], states)
    table.add("  the same, at the robot", "brakes and holds", Outcome(math.nan, rest, braking, states.samples, lost))


def grown(bag: Path, by: int) -> None:
    """Wait until a bag has grown by so many bytes."""

    def size() -> int:
        return sum(file.stat().st_size for file in bag.glob("*.mcap"))

    goal = size() + by
    assert wait_until(lambda: size() > goal, LOADED), bag

"""A design that is ended by a signal leaves no process behind, and ends within a moment, compiled code or not."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest

DESIGN = ["design", "--time-limit", "60", "-o", "designed.yaml"]
PROMPT = 8.0  # s in which a signalled design has ended; about 0.3 s where nobody else computes
ALONE = "import os, sys; os.sched_setaffinity(0, {min(os.sched_getaffinity(0))}); "
RUN = "from robot_ident.cli.main import main; sys.exit(main())"


def wait_for(condition: object, seconds: float) -> bool:
    """Return whether a condition comes true in time."""
    assert callable(condition)
    until = time.monotonic() + seconds
    while not (met := bool(condition())) and time.monotonic() < until:
        time.sleep(0.05)
    return met


def busy(process: psutil.Process) -> bool:
    """Tell a worker that computes from one that is being started."""
    try:
        return process.cpu_times().user > 1.5
    except psutil.Error:
        return False


def alive(process: psutil.Process) -> bool:
    """Tell a process that runs from one that has ended, collected or not."""
    try:
        return process.status() != psutil.STATUS_ZOMBIE
    except psutil.Error:
        return False


def hear_hangup() -> None:
    """Take SIGHUP as a terminal's program does, although these tests may run below nohup."""
    signal.signal(signal.SIGHUP, signal.SIG_DFL)


@pytest.fixture
def started(tmp_path: Path) -> Iterator[list[subprocess.Popen[bytes]]]:
    """Processes that are ended with all that they started."""
    made: list[subprocess.Popen[bytes]] = []
    yield made
    for popen in made:
        if popen.poll() is None:
            popen.kill()
        popen.wait()


@pytest.mark.skipif(sys.platform != "linux", reason="processes are tied by Linux")
@pytest.mark.parametrize(
    "number", [signal.SIGKILL, *(pytest.param(one, marks=pytest.mark.long) for one in (signal.SIGTERM, signal.SIGHUP))]
)
def test_no_worker_outlives_a_design(number: int, tmp_path: Path, started: list[subprocess.Popen[bytes]]) -> None:
    if len(os.sched_getaffinity(0)) < 2:
        pytest.skip("one processor: no workers")
    popen = subprocess.Popen(
        [sys.executable, "-m", "robot_ident", *DESIGN],
        cwd=tmp_path,
        stderr=subprocess.DEVNULL,
        preexec_fn=hear_hangup,
    )
    started.append(popen)
    of = psutil.Process(popen.pid)
    workers: list[psutil.Process] = []

    def at_work() -> bool:
        workers[:] = [child for child in of.children(recursive=True) if child not in workers] + workers
        return sum(map(busy, workers)) >= 2

    assert wait_for(at_work, 60.0), workers
    popen.send_signal(number)
    code = popen.wait(PROMPT)
    assert code == (-number if number == signal.SIGKILL else 128 + number)
    assert wait_for(lambda: not any(map(alive, workers)), PROMPT), workers
    assert not list(tmp_path.iterdir())


@pytest.mark.long
@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="a process can't be given one processor here")
@pytest.mark.parametrize("number", [signal.SIGTERM, pytest.param(signal.SIGHUP, marks=pytest.mark.long)])
def test_a_design_in_compiled_code_ends(number: int, tmp_path: Path, started: list[subprocess.Popen[bytes]]) -> None:
    command = [sys.executable, "-c", ALONE + RUN, *DESIGN]
    popen = subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.DEVNULL, preexec_fn=hear_hangup)
    started.append(popen)
    assert wait_for(lambda: psutil.Process(popen.pid).cpu_times().user > 4.0, 60.0)
    popen.send_signal(number)
    assert popen.wait(PROMPT) == 128 + number
    assert not list(tmp_path.iterdir())


def test_a_node_ends_with_the_command_that_started_it(tmp_path: Path, started: list[subprocess.Popen[bytes]]) -> None:
    pytest.importorskip("rclpy")
    start = (
        "import time, sys; from pathlib import Path; from robot_ident.cli.demo import NodeProcess; "
        "NodeProcess('recorder', {'output': Path('bag').absolute()}, 99, Path('.')); time.sleep(60)"
    )
    popen = subprocess.Popen([sys.executable, "-c", start], cwd=tmp_path)
    started.append(popen)
    nodes: list[psutil.Process] = []

    def recording() -> bool:
        nodes[:] = psutil.Process(popen.pid).children()
        return "record" in (tmp_path / "recorder.log").read_text() if nodes else False

    assert wait_for(recording, 60.0), (tmp_path / "recorder.log").read_text()
    popen.kill()
    assert wait_for(lambda: not any(map(alive, nodes)), 30.0), (tmp_path / "recorder.log").read_text()

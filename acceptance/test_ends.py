"""Publishers that play to their end and exit, again and again on a busy machine: none ends by a signal.

Run by `make acceptance`; about ten minutes. The C library looks at every block of memory as it is freed, and aborts
where it was written to from outside (MALLOC_CHECK_, where its debugging library is installed); what was freed is
overwritten. Robot, recorder and estimator run on and end last.
ROBOT_IDENT_ENDS: number of publishers in place of 30.
"""

from __future__ import annotations

import ctypes
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from bench import LONG, Node, isolate
from test_soak import motion

pytest.importorskip("rclpy")

ENDS = int(os.environ.get("ROBOT_IDENT_ENDS", "30"))
BUSY = 2  # processes that do nothing but take time, for each core
CHECKER = "libc_malloc_debug.so.0"
PATIENT = {"state_timeout": 10.0, "stall": 10.0, "tracking_error": "[10.0]", "effort_limit": 0.0}


@contextmanager
def busy() -> Iterator[None]:
    """Keep every core busy, with work that gives way to the nodes now and then."""
    command = [sys.executable, "-c", "import os; os.nice(10)\nwhile True: pass"]
    made = [subprocess.Popen(command) for _ in range(BUSY * (os.cpu_count() or 1))]
    try:
        yield
    finally:
        for process in made:
            process.kill()
            process.wait()


@pytest.fixture
def checked(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let processes that are started look after their memory."""
    monkeypatch.setenv("MALLOC_PERTURB_", "165")
    try:
        ctypes.CDLL(CHECKER)
    except OSError:
        print(f"\n{CHECKER} is not there: memory is not looked at block by block")
        return
    monkeypatch.setenv("LD_PRELOAD", CHECKER)
    monkeypatch.setenv("MALLOC_CHECK_", "3")


def test_publishers_end_well(tmp_path: Path, checked: None) -> None:
    isolate(tmp_path)
    excitation = str(motion(tmp_path))
    beside = [
        Node("recorder", tmp_path, output=tmp_path / "bag"),
        Node("simulated_kuka", tmp_path),
        Node("estimator", tmp_path, trajectory=excitation),
    ]
    given = {"trajectory": excitation, "periods": 2, "autostart": "true", "exit_when_done": "true", **PATIENT}
    ended: list[int] = []
    try:
        with busy():
            for _ in range(ENDS):
                publisher = Node("trajectory_publisher", tmp_path, **given)
                try:
                    ended.append(publisher.popen.wait(5.0 * LONG))
                finally:
                    publisher.kill_if_alive()
                assert ended[-1] == 0, publisher.text
                for node in beside:
                    assert node.popen.poll() is None, node.text
        assert [node.end(signal.SIGINT) for node in beside] == [0, 0, 0], [node.text for node in beside]
    finally:
        for node in beside:
            node.kill_if_alive()
    print(f"\n{len(ended)} publishers played to their end and exited")

"""What the demo waits for: as long as it goes on it may take any time; what stands still or ends is told."""

from __future__ import annotations

import socket
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from robot_ident.cli import demo
from robot_ident.cli.demo import free_domains, wait_for
from robot_ident.errors import RobotIdentError


class Machine:
    """A clock that the test moves: each look of `wait_for` takes `pace` seconds."""

    def __init__(self, pace: float) -> None:
        self.now, self.pace, self.looks = 0.0, pace, 0

    def monotonic(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        self.now += max(seconds, self.pace)
        self.looks += 1


@pytest.fixture
def node() -> Any:
    """A node that runs."""
    return SimpleNamespace(node="recorder", running=True, log=Path("logs/run_1/recorder.log"), end=lambda: None)


def machine(monkeypatch: pytest.MonkeyPatch, pace: float) -> Machine:
    made = Machine(pace)
    monkeypatch.setattr(demo, "time", made)
    return made


def test_a_starved_machine_only_takes_longer(monkeypatch: pytest.MonkeyPatch, node: Any) -> None:
    slow = machine(monkeypatch, 0.9)
    done = lambda: slow.now > 5000.0  # noqa: E731
    wait_for(done, [node], lambda: {"run_1": slow.now // 250.0}, 300.0)
    assert slow.now > 5000.0


def test_what_stands_still_is_told(monkeypatch: pytest.MonkeyPatch, node: Any) -> None:
    slow = machine(monkeypatch, 0.5)
    with pytest.raises(RobotIdentError, match=r"run_2 has stood still at 20\.0 s for 300 s; .*logs$"):
        wait_for(lambda: False, [node], lambda: {"run_1": slow.now, "run_2": min(slow.now, 20.0)}, 300.0)
    assert 319.0 < slow.now < 325.0


def test_time_in_which_this_process_stood_still_counts_little(monkeypatch: pytest.MonkeyPatch, node: Any) -> None:
    stopped = machine(monkeypatch, 3600.0)
    wait_for(lambda: stopped.looks > 200, [node], lambda: {"run_1": 1.0}, 300.0)


def test_a_domain_that_is_used_is_left_alone() -> None:
    first = free_domains(3)
    assert len(set(first)) == 3
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as participant:
        participant.bind(("", 7410 + 250 * first[1] + 2))
        again = free_domains(3)
    assert first[1] not in again and len(set(again)) == 3
    with pytest.raises(RobotIdentError, match="101 DDS domains are needed"):
        free_domains(101)


def test_two_that_look_at_once_find_different_domains() -> None:
    """Before either has started a node."""
    look = (
        "import os, sys; os.getpid = lambda: 7\n"
        "from robot_ident.cli.demo import free_domains\n"
        "print(*free_domains(3), flush=True); sys.stdin.read()"
    )
    begun = [
        subprocess.Popen([sys.executable, "-c", look], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        for _ in range(2)
    ]
    told = [process.stdout.readline().split() for process in begun if process.stdout]
    for process in begun:
        process.communicate()
    assert all(len(set(domains)) == 3 for domains in told) and not set(told[0]) & set(told[1])


def test_a_node_that_ends_too_soon_is_named(monkeypatch: pytest.MonkeyPatch, node: Any) -> None:
    machine(monkeypatch, 0.1)
    node.running = False
    with pytest.raises(RobotIdentError, match="node recorder ended too soon; its log: logs/run_1/recorder.log"):
        wait_for(lambda: False, [node], dict, 300.0)

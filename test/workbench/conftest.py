"""Recordings of a robot that hides something from its model, a desk to open them on, and a workbench that serves."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from robot_ident.trajectories.excitation import Excitation
from robot_ident.trajectories.fourier_series import FourierSeries
from robot_ident.workbench.allowed_paths import Allowed
from robot_ident.workbench.controller import Desk
from robot_ident.workbench.jobs import Job
from robot_ident.workbench.session import Session
from robot_ident.workbench.tasks import Work

HIDDEN = "3"
TRAINING, UNSEEN = ("run_1", "run_2"), "run_3"


@pytest.fixture(scope="session")
def recordings(arm: Any, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with three recordings of the same robot, on motions of their own, by `simulate --hidden`."""
    from robot_ident.cli.main import main

    folder = tmp_path_factory.mktemp("hidden")
    for number, name in enumerate((*TRAINING, UNSEEN)):
        a, b = 0.22 * np.random.default_rng(7 + number).normal(size=(2, 3, 5))
        motion = folder / f"motion_{number}.yaml"
        series = FourierSeries(0.1, np.array([0.0, -0.1, -0.2]), a, b)
        Excitation("kuka_ir361", arm.robot.joints, series, 150.0).write(motion)
        words = ["simulate", motion, "--hidden", HIDDEN, "--periods", "8", "--seed", number, "-o", folder / name]
        assert main([str(word) for word in words]) == 0
    return folder


@pytest.fixture
def desk(recordings: Path, tmp_path: Path) -> Iterator[Desk]:
    """Return a desk whose sessions are kept in a folder of their own."""
    made = Desk(tmp_path / "sessions", Allowed(recordings))
    yield made
    made.close()


class Bench:
    """A session whose tasks are done in this process."""

    def __init__(self, session: Session) -> None:
        self.session = session
        self.work: Work | None = None

    def do(self, task: str, **more: Any) -> None:
        self.work = self.work or Work(self.session)
        self.work.do({"task": task, **more}, lambda share, words: None)


@pytest.fixture(scope="module")
def bench(recordings: Path, tmp_path_factory: pytest.TempPathFactory) -> Bench:
    """Return a session that was opened and diagnosed."""
    desk = Desk(tmp_path_factory.mktemp("sessions"), Allowed(recordings))
    made = Bench(desk.open(TRAINING, [UNSEEN]))
    made.do("open")
    made.do("diagnose", number=0)
    return made


@dataclass
class Served:
    """A workbench in a process of its own: its address, the port, and how to end it."""

    address: str
    process: subprocess.Popen[str]

    @property
    def port(self) -> int:
        found = re.search(r":(\d+)/", self.address)
        assert found
        return int(found[1])


@pytest.fixture(scope="module")
def serve() -> Iterator[Callable[..., Served]]:
    """Return a function that starts a workbench by its command line."""
    running: list[subprocess.Popen[str]] = []

    def start(folder: Path, *words: object) -> Served:
        command = [sys.executable, "-m", "robot_ident", "workbench", *map(str, words), "--port", "0", "--no-browser"]
        process = subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, text=True, env=_environment())
        running.append(process)
        assert process.stdout is not None
        line = process.stdout.readline()
        address = re.search(r"http://\S+", line)
        assert address, f"no address in {line!r}"
        return Served(address[0], process)

    yield start
    for process in running:
        process.kill()
        process.wait()


def _environment() -> Mapping[str, str]:
    import robot_ident

    return {**os.environ, "PYTHONPATH": str(Path(robot_ident.__file__).parents[1])}


@pytest.fixture
def settled() -> Callable[[Any], Job]:
    """Return a function that waits until the work under way has ended."""

    def wait(jobs: Any, seconds: float = 120.0) -> Job:
        end = time.monotonic() + seconds
        while (job := jobs.look()).running:
            assert time.monotonic() < end, f"still {job.words}"
            time.sleep(0.02)
        return job

    return wait

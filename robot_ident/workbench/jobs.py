"""Slow work in a process of its own, one task at a time, with progress; it can be cancelled at any moment."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
import time
import traceback
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any, Literal

from robot_ident.errors import InputError, RobotIdentError
from robot_ident.memory import OUT_OF_MEMORY, bounded
from robot_ident.parallel import end_with
from robot_ident.workbench.allowed_paths import Stamp
from robot_ident.workbench.session import Session

State = Literal["idle", "running", "done", "failed", "cancelled"]


@dataclass(frozen=True)
class Job:
    """A task and how it stands: share [0, 1] that is done, what is being done (or why it failed), seconds since it
    began. number: counts the tasks. trace: of a bug.
    """

    number: int = 0
    state: State = "idle"
    task: Mapping[str, Any] | None = None
    share: float = 0.0
    words: str = ""
    seconds: float = 0.0
    trace: str = ""

    @property
    def running(self) -> bool:
        """Whether it is under way."""
        return self.state == "running"


class Jobs:
    """The worker of one session, started with the first task."""

    def __init__(
        self,
        folder: Path,
        effects_from: Sequence[str] = (),
        wrote: Callable[[Path, Stamp | None], None] = lambda path, left: None,
    ) -> None:
        """Keep what a worker needs: effects_from: the Python files that the command line named; `wrote(path, stamp)`
        is called for every file that a task has saved.
        """
        self._folder, self._effects_from, self._wrote = folder, tuple(effects_from), wrote
        self._lock = threading.Lock()
        self._job = Job()
        self._began = 0.0
        self._process: BaseProcess | None = None
        self._pipe: Connection | None = None

    def start(self, task: Mapping[str, Any]) -> Job:
        """Begin a task; InputError while another one is under way."""
        with self._lock:
            self._listen()
            if self._job.running:
                raise InputError("something is being computed already; wait for it, or cancel it")
            if self._process is None or not self._process.is_alive():
                context = multiprocessing.get_context("spawn")
                self._pipe, theirs = context.Pipe()
                told = (theirs, str(self._folder), self._effects_from, os.getpid())
                self._process = context.Process(target=_serve, args=told, daemon=True)
                self._process.start()
                theirs.close()
            self._began = time.monotonic()
            self._job = Job(self._job.number + 1, "running", dict(task), 0.0, "starting")
            assert self._pipe is not None
            self._pipe.send(dict(task))
            return self._job

    def look(self) -> Job:
        """Return how the latest task stands."""
        with self._lock:
            self._listen()
            if self._job.running:
                self._job = replace(self._job, seconds=time.monotonic() - self._began)
            return self._job

    def cancel(self) -> None:
        """Give up the task that is under way; nothing of it stays."""
        with self._lock:
            self._listen()
            if self._job.running:
                self._stop()
                self._job = replace(self._job, state="cancelled", words="cancelled; nothing was changed")

    def close(self) -> None:
        """End the worker."""
        with self._lock:
            self._stop()

    def _stop(self) -> None:
        if self._process is not None:
            self._process.kill()
            self._process.join()
        if self._pipe is not None:
            self._pipe.close()
        self._process = self._pipe = None

    def _listen(self) -> None:
        """Take in what the worker has said since."""
        if self._pipe is None or not self._job.running:
            return
        try:
            while self._job.running and self._pipe.poll():
                kind, *rest = self._pipe.recv()
                if kind == "progress":
                    self._job = replace(self._job, share=rest[0], words=rest[1])
                elif kind == "done":
                    self._job = replace(self._job, state="done", share=1.0, words=rest[0])
                    for path, left in rest[1].items():
                        self._wrote(Path(path), left)
                else:
                    self._job = replace(self._job, state="failed", words=rest[0], trace=rest[1])
        except (EOFError, OSError):
            self._stop()
            words = "the process that computes has ended unexpectedly (out of memory?); what was done before is safe"
            self._job = replace(self._job, state="failed", words=words)


def _serve(pipe: Connection, folder: str, effects_from: Sequence[str], server: int) -> None:
    """Do tasks until the other end of the pipe is closed, or the server ends."""
    end_with(server, by_kernel=False)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C in the terminal is the server's to handle
    from robot_ident.workbench import tasks

    session, kept = Session.open(Path(folder)), None
    while True:
        try:
            task = pipe.recv()
        except (EOFError, OSError):  # the server has ended, in good order or not
            return
        try:
            kept = kept or tasks.Work(session, effects_from)
            with bounded():
                kept.do(task, lambda share, words: pipe.send(("progress", share, words)))
            said: tuple[Any, ...] = ("done", kept.said, kept.wrote)
        except RobotIdentError as error:
            said = ("failed", str(error), "")
        except MemoryError:
            said = ("failed", OUT_OF_MEMORY, "")
        except Exception as error:  # noqa: BLE001  a bug must not end the session; it is shown with its traceback
            said = ("failed", f"{type(error).__name__}: {error}", traceback.format_exc())
        try:
            pipe.send(said)
        except OSError:  # nobody listens any more; what was computed is on disk
            return

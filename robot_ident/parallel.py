"""Runs independent cases in parallel: in processes of this machine, or on a Dask cluster.

A process of this machine ends with the one that started it, whatever ends that.
"""

from __future__ import annotations

import ctypes
import importlib
import os
import pickle
import signal
import socket
import sys
import threading
import time
import warnings
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import closing, contextmanager
from contextvars import ContextVar
from typing import Any, NoReturn, TypeVar

from robot_ident.errors import InputError

Case = TypeVar("Case")
Result = TypeVar("Result")
Preparation = tuple[Callable[..., object], tuple[Any, ...]]

came: list[int] = []
"""The signals that have come to end what this process does, in their order."""

_WATCH = 0.5  # s between two looks at the process that started this one
_PR_SET_PDEATHSIG = 1  # of linux/prctl.h
_CONNECT = 10.0  # s to wait for a scheduler, and then for a worker
_preparations: list[Preparation] = []
_prepared: set[bytes] = set()
_cluster: ContextVar[Any] = ContextVar("cluster", default=None)


class Interrupt(KeyboardInterrupt):
    """Another type than Python's own, which ends `python -m` by the signal, caught or not, where it meets `exec`."""


def end_by(number: int) -> NoReturn:
    """Raise what ends the work of this process when a signal comes: an interrupt for Ctrl-C, else SystemExit."""
    raise Interrupt if number == signal.SIGINT else SystemExit(128 + number)


@contextmanager
def nothing_swallowed() -> Iterator[Callable[[], bool]]:
    """Raise at the end what a signal has raised inside and compiled code that calls Python has swallowed.

    Gives a function that tells whether a signal has come since.
    """
    before = len(came)
    yield lambda: len(came) > before
    if len(came) > before:
        end_by(came[-1])


def available_workers() -> int:
    """Return the number of processors that this process may use."""
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:  # not on every system
        return os.cpu_count() or 1


def prepare(function: Callable[..., object], *arguments: Any) -> None:
    """Have every worker call function(*arguments) before its first case, as this process has done for itself."""
    if (function, arguments) not in _preparations:
        _preparations.append((function, arguments))


PARENT = "ROBOT_IDENT_PARENT"
"""Variable of the environment: the process with which a node ends that was started by one of our commands."""


def end_with(parent: int, by_kernel: bool, number: int = signal.SIGKILL) -> None:
    """Have a signal sent to this process when `parent`, which started it, ends, whatever ends that.

    by_kernel: Linux does it at once; for a process that a thread started which lives as long as `parent`, since Linux
    means the thread. Else a thread of this process looks twice a second.
    """
    tied = by_kernel and sys.platform == "linux" and _ask_kernel(number)
    if os.getppid() != parent:  # which had ended before
        os.kill(os.getpid(), number)
    if not tied:
        threading.Thread(target=_watch, args=(parent, number), name="parent", daemon=True).start()


def _ask_kernel(number: int) -> bool:
    try:
        return int(ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, int(number), 0, 0, 0)) == 0
    except (OSError, AttributeError):  # a C library without it
        return False


def _watch(parent: int, number: int) -> None:
    """End this process once its parent has ended and another has taken its place."""
    while os.getppid() == parent:
        time.sleep(_WATCH)
    os.kill(os.getpid(), number)


@contextmanager
def on_cluster(address: str | None) -> Iterator[None]:
    """Hand all cases inside to the Dask scheduler at an address (`tcp://HOST:PORT`); None: to local processes.

    Raises InputError where Dask isn't installed, the scheduler doesn't answer or has no worker.
    """
    if not address:
        yield
        return
    client = _client(address)
    token = _cluster.set(client)
    try:
        yield
    finally:
        _cluster.reset(token)
        client.close()


def _require_listener(address: str) -> None:
    """Raise InputError where an address is none, or nobody comes to listen there: Dask's own client leaves its threads
    behind then. A scheduler that is just being started is waited for.
    """
    scheme, mark, place = address.rpartition("://")
    host, colon, port = place.rpartition(":")
    if not host or not port.isdigit() or int(port) > 65535 or (mark and not scheme.isalnum()):
        raise InputError(f"--cluster {address}: HOST:PORT or tcp://HOST:PORT of a Dask scheduler was expected")
    until = time.monotonic() + _CONNECT
    while True:
        try:
            with socket.create_connection((host.strip("[]"), int(port)), timeout=_CONNECT):
                return
        except OSError as error:
            if not isinstance(error, ConnectionRefusedError) or time.monotonic() > until:
                raise InputError(f"--cluster {address}: no Dask scheduler answers there ({error})") from error
        time.sleep(0.1)


def _client(address: str) -> Any:
    try:
        distributed: Any = importlib.import_module("distributed")
    except ImportError:
        raise InputError("--cluster needs Dask: pip install 'robot_ident[cluster]'") from None
    _require_listener(address)
    try:
        client = distributed.Client(address, timeout=_CONNECT, set_as_default=False)
    except (OSError, ValueError) as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise InputError(f"--cluster {address}: no Dask scheduler answers there ({reason})") from error
    try:
        client.wait_for_workers(1, timeout=_CONNECT)
    except TimeoutError:
        client.close()
        raise InputError(
            f"--cluster {address}: the scheduler has no worker; start one by: dask worker {address}"
        ) from None
    return client


def _dask_backend(client: Any) -> Any:
    """Return joblib's way to a Dask cluster; one that hands its work over even where there is a single worker."""
    dask: Any = importlib.import_module("joblib._dask")

    class Backend(dask.DaskDistributedBackend):  # type: ignore[misc]
        def effective_n_jobs(self, n_jobs: int) -> int:
            return max(2, int(super().effective_n_jobs(n_jobs)))  # of a single job joblib would make a plain loop here

    return Backend(client=client)


def _local_backend() -> Any:
    """Return joblib's way to processes of this machine, each of which ends with this one."""
    backends: Any = importlib.import_module("joblib._parallel_backends")
    ties = (os.getpid(), threading.current_thread() is threading.main_thread())

    class Backend(backends.LokyBackend):  # type: ignore[misc]
        def configure(self, *arguments: Any, **options: Any) -> int:
            return int(super().configure(*arguments, initializer=end_with, initargs=ties, **options))

    return Backend(inner_max_num_threads=1)


def completed(
    function: Callable[[Case], Result], cases: Sequence[Case], workers: int | None = None
) -> Generator[tuple[int, Result], None, None]:
    """Yield (index, function(case)) as cases are completed, in any order.

    `function` and `cases` must be picklable when there are several workers. Each local worker computes with one thread;
    `workers` limits them and means nothing on a cluster, where a lost worker's unfinished cases are run by another. An
    exception of a case is raised here. Closing the iterator gives up what hasn't begun.
    """
    client = _cluster.get()
    workers = min(workers or available_workers(), len(cases))
    if not cases:
        return
    if workers <= 1 and client is None:
        for index, case in enumerate(cases):
            yield index, function(case)
        return
    from joblib import Parallel, delayed, parallel_config

    preparations = pickle.dumps(tuple(_preparations))
    # bytes, lest the cluster keep a part of the work on one worker alone and lose it with that
    work = (delayed(_run)(preparations, i, pickle.dumps((function, case))) for i, case in enumerate(cases))
    with parallel_config(backend=_local_backend() if client is None else _dask_backend(client)):
        size = {"n_jobs": workers, "max_nbytes": None} if client is None else {"n_jobs": -1}
        pool = Parallel(return_as="generator_unordered", batch_size=1, pre_dispatch="2 * n_jobs", **size)
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", ".*have been cancelled.*", UserWarning)  # on purpose, when closed early
            with _interrupt_ignored():
                results = pool(work)
            with closing(results):
                yield from results


@contextmanager
def _interrupt_ignored() -> Iterator[None]:
    """Ignore Ctrl-C for the moment in which processes are started: they inherit that, and leave it to this one to end
    them.
    """
    if threading.current_thread() is not threading.main_thread():  # where signals can't be changed
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def run_parallel(
    function: Callable[[Case], Result],
    cases: Sequence[Case],
    workers: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> list[Result]:
    """Return function(case) for every case, in the order of the cases; `progress(done, of)` is called after each."""
    results: dict[int, Result] = {}
    for index, result in completed(function, cases, workers):
        results[index] = result
        if progress is not None:
            progress(len(results), len(cases))
    return [results[index] for index in range(len(cases))]


def _run(preparations: bytes, index: int, work: bytes) -> tuple[int, Any]:
    """Run one case in a worker, which is prepared for it first."""
    if preparations not in _prepared:
        for prepare_worker, arguments in pickle.loads(preparations):
            prepare_worker(*arguments)
        _prepared.add(preparations)
    function, case = pickle.loads(work)
    return index, function(case)

"""Runs independent cases in parallel processes."""

from __future__ import annotations

import os
import signal
import threading
import warnings
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import closing, contextmanager
from typing import TypeVar

Case = TypeVar("Case")
Result = TypeVar("Result")


def available_workers() -> int:
    """Return the number of processors that this process may use."""
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:  # not on every system
        return os.cpu_count() or 1


def completed(
    function: Callable[[Case], Result], cases: Sequence[Case], workers: int | None = None
) -> Generator[tuple[int, Result], None, None]:
    """Yield (index, function(case)) as cases are completed, in any order.

    `function` and `cases` must be picklable when there are several workers; each worker computes with one thread. An
    exception of a case is raised here. Closing the iterator gives up what hasn't begun.
    """
    workers = min(workers or available_workers(), len(cases))
    if workers <= 1:
        for index, case in enumerate(cases):
            yield index, function(case)
        return
    from joblib import Parallel, delayed, parallel_config

    with parallel_config(backend="loky", inner_max_num_threads=1):
        pool = Parallel(
            n_jobs=workers, return_as="generator_unordered", batch_size=1, pre_dispatch=2 * workers, max_nbytes=None
        )
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", ".*have been cancelled.*", UserWarning)  # on purpose, when closed early
            with _interrupt_ignored():
                results = pool(delayed(_numbered)(function, i, case) for i, case in enumerate(cases))
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


def _numbered(function: Callable[[Case], Result], index: int, case: Case) -> tuple[int, Result]:
    return index, function(case)

"""Cases in parallel processes."""

from __future__ import annotations

import importlib
import os
import socket
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from math import sqrt
from pathlib import Path
from typing import Any

import pytest

from robot_ident.cli.values import register_effects
from robot_ident.effects import CATALOGUE
from robot_ident.errors import InputError
from robot_ident.parallel import completed, on_cluster, run_parallel


@pytest.mark.parametrize("workers", [1, 2])
def test_results_come_in_the_order_of_the_cases(workers: int) -> None:
    seen: list[tuple[int, int]] = []
    results = run_parallel(sqrt, [16.0, 9.0, 4.0], workers, lambda done, of: seen.append((done, of)))
    assert results == [4.0, 3.0, 2.0]
    assert seen == [(1, 3), (2, 3), (3, 3)]


@pytest.mark.parametrize("workers", [1, 2])
def test_the_exception_of_a_case_is_raised(workers: int) -> None:
    with pytest.raises(ValueError):
        run_parallel(sqrt, [4.0, -1.0], workers)


def test_who_closes_early_gets_no_more() -> None:
    results = completed(sqrt, [1.0, 4.0, 9.0], 1)
    assert next(results) == (0, 1.0)
    results.close()
    assert list(results) == []


def test_no_cases() -> None:
    assert run_parallel(sqrt, [], 2) == []


@pytest.fixture
def cases(monkeypatch: pytest.MonkeyPatch) -> Any:
    """The functions that other processes import by name."""
    monkeypatch.syspath_prepend(str(Path(__file__).parent))
    return importlib.import_module("parallel_cases")


@contextmanager
def scheduler(workers: int) -> Iterator[tuple[str, list[subprocess.Popen[bytes]]]]:
    """Start a Dask scheduler and workers as processes; yield its address and the workers."""
    pytest.importorskip("distributed", reason="the extra [cluster] is not installed")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        address = f"tcp://127.0.0.1:{free.getsockname()[1]}"
    root = Path(__file__).resolve().parents[1]
    paths = os.pathsep.join([str(root), str(root / "test"), *filter(None, [os.environ.get("PYTHONPATH")])])
    environment = {**os.environ, "PYTHONPATH": paths, "DASK_DISTRIBUTED__ADMIN__LOW_LEVEL_LOG_LENGTH": "0"}
    quiet = {"env": environment, "stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    dask = [sys.executable, "-m", "distributed.cli.dask_scheduler"]
    with tempfile.TemporaryDirectory() as folder:
        host, port = address.removeprefix("tcp://").split(":")
        started = [subprocess.Popen([*dask, "--host", host, "--port", port, "--no-dashboard"], cwd=folder, **quiet)]  # type: ignore[call-overload]
        worker = [sys.executable, "-m", "distributed.cli.dask_worker", address, "--nthreads", "1", "--no-nanny"]
        for _ in range(workers):
            started.append(subprocess.Popen([*worker, "--no-dashboard"], cwd=folder, **quiet))  # type: ignore[call-overload]
        try:
            yield address, started[1:]
        finally:
            for process in started:
                process.kill()
                process.wait()


def test_a_cluster_does_the_same_work_and_a_lost_worker_loses_no_case(cases: Any, tmp_path: Path) -> None:
    work = [(str(tmp_path), number) for number in range(8)]
    with scheduler(2) as (address, workers), on_cluster(address):
        pids = {pid for _, pid in completed(cases.process_of, range(6))}
        assert os.getpid() not in pids, "the cases have to run on the cluster"
        done: dict[int, int] = {}
        for index, result in completed(cases.slow_square, work):
            done[index] = result
            if len(done) == 2:
                workers[0].kill()
    assert done == {number: number * number for number in range(8)}
    calls = [name.name for name in tmp_path.iterdir()]
    assert len(calls) <= 8 + 2, "only what the lost worker had in hand is done again"


def test_an_exception_comes_back_from_a_cluster() -> None:
    with scheduler(1) as (address, _), on_cluster(address), pytest.raises(ValueError):
        run_parallel(sqrt, [4.0, -1.0])


def test_a_scheduler_that_is_not_there_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("distributed", reason="the extra [cluster] is not installed")
    monkeypatch.setattr("robot_ident.parallel._CONNECT", 0.5)
    address = "tcp://127.0.0.1:9"
    with pytest.raises(InputError, match=f"--cluster {address}: no Dask scheduler answers"), on_cluster(address):
        pass


@pytest.mark.parametrize("address", ["nonsense", "tcp://127.0.0.1", "127.0.0.1:port", "tcp://:8786", "127.0.0.1:99999"])
def test_what_is_no_address_is_refused_before_anyone_is_called(monkeypatch: pytest.MonkeyPatch, address: str) -> None:
    distributed = pytest.importorskip("distributed", reason="the extra [cluster] is not installed")
    monkeypatch.setattr(distributed, "Client", None)
    with pytest.raises(InputError, match="HOST:PORT of a Dask scheduler was expected"), on_cluster(address):
        pass


@pytest.mark.parametrize("place", ["processes", "cluster"])
def test_workers_know_the_effects_of_a_users_file(place: str, cases: Any, tmp_path: Path) -> None:
    name, file = f"tight_spot_{place}", tmp_path / "sticky.py"
    text = (Path(__file__).resolve().parents[1] / "examples/my_effects.py").read_text()
    file.write_text(text.replace("tight_spot", name))
    register_effects([str(file)])
    file.unlink()  # a worker on another machine doesn't have it either
    try:
        if place == "processes":
            known = run_parallel(cases.known_where, [name] * 4, 2)
        else:
            with scheduler(1) as (address, _), on_cluster(address):
                known = run_parallel(cases.known_where, [name] * 4)
    finally:
        del CATALOGUE[name]
    assert all(there for there, _ in known)
    assert os.getpid() not in {pid for _, pid in known}

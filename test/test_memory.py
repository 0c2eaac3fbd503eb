"""A run that needs more memory than there is says so in one line, and writes nothing."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from robot_ident import memory

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="limits of Linux")
resource = pytest.importorskip("resource")


def test_a_recording_beyond_the_memory_is_told_in_one_line(tmp_path: Path) -> None:
    rows = 4_000_000
    names = [f"joint_{k}" for k in (1, 2, 3)]
    zeros = np.zeros((rows, 3))
    np.savez_compressed(tmp_path / "long.npz", t=np.arange(rows) / 1e3, q=zeros, tau=zeros, names=names)
    limit = 500 << 20  # bytes: the libraries take half of it, the arrays more than the rest
    done = subprocess.run(
        [sys.executable, "-m", "robot_ident", "identify", "long.npz", "-o", "model.yaml"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
        env={**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_DATA, (limit, limit)),
    )
    assert done.returncode == 2, done.stderr
    assert done.stderr.count("\n") == 1 and "more memory than the machine has free" in done.stderr, done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["long.npz"]


def test_what_is_beyond_free_memory_is_refused_and_the_limit_comes_back(monkeypatch: pytest.MonkeyPatch) -> None:
    before = resource.getrlimit(resource.RLIMIT_DATA)
    free = memory.available()
    assert free is not None and 0 < free < os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") * 2
    monkeypatch.setattr(memory, "available", lambda: 256 << 20)
    with memory.bounded():
        np.ones(8 << 20)  # 64 MiB
        with pytest.raises(MemoryError):
            np.ones(64 << 20)
    assert resource.getrlimit(resource.RLIMIT_DATA) == before


def test_a_container_with_less_than_the_machine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(memory, "_GROUP", tmp_path)
    whole = memory.available()
    (tmp_path / "memory.max").write_text("max\n")
    (tmp_path / "memory.stat").write_text("anon 1000000\nfile 90000000\n")
    assert memory.available() == pytest.approx(whole, rel=0.1)
    (tmp_path / "memory.max").write_text("51000000\n")
    assert memory.available() == 50_000_000

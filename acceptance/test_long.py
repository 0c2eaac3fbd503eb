"""The tests of `test/` that are marked long, as `make test` runs the others: those of the nodes apart."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

TESTS = Path(__file__).resolve().parents[1] / "test"
APART = TESTS / "nodes"
SHARED = "--dist", "loadfile"


@pytest.mark.parametrize(
    "where", [("-n", "auto", *SHARED, f"--ignore={APART}", TESTS), ("-n", "2", *SHARED, APART)], ids=str
)
def test_long_ones(where: tuple[str | Path, ...], capfd: pytest.CaptureFixture[str]) -> None:
    environment = {**os.environ, "ROBOT_IDENT_TEST_INSTALLED": "1", "PYTEST_ADDOPTS": ""}
    with capfd.disabled():
        command = [sys.executable, "-m", "pytest", "-m", "long", *map(str, where)]
        done = subprocess.run(command, cwd=TESTS.parent, env=environment, check=False)
    assert done.returncode == 0

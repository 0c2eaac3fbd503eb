"""A device that is full takes no result: one line, and no traceback."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full here")
@pytest.mark.parametrize("words", [["effects"], ["effects", "--json"]])
def test_a_full_device_as_standard_output(words: list[str]) -> None:
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(
            [sys.executable, "-P", "-m", "robot_ident.cli.main", *words],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
        )
    assert done.returncode == 2
    assert done.stderr == "robot_ident effects: standard output can't be written (No space left on device)\n"


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full here")
@pytest.mark.parametrize(("words", "code"), [(["effects"], 0), (["info", "nowhere.npz"], 2), (["info"], 2)])
def test_a_full_device_as_standard_error(words: list[str], code: int) -> None:
    """Nobody can be told; the code still says what came of it."""
    with Path("/dev/full").open("w") as full:
        command = [sys.executable, "-P", "-m", "robot_ident.cli.main", *words]
        done = subprocess.run(command, stdout=subprocess.DEVNULL, stderr=full, check=False)
    assert done.returncode == code


@pytest.mark.parametrize("words", [["effects"], ["effects", "--json"]])
def test_a_closed_standard_output(words: list[str]) -> None:
    """What is printed goes nowhere, and the rest is done as ever."""
    command = [sys.executable, "-P", "-m", "robot_ident.cli.main", *words]
    done = subprocess.run(["sh", "-c", '"$@" >&-', "sh", *command], stderr=subprocess.PIPE, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")

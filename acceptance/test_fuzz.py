"""Thousands of damaged files of every kind: one clear line or an answer, no hang, no crash, no gigabyte.

The tests of test/fuzz with other seeds at every run. ROBOT_IDENT_FUZZ: files of each kind (2000).
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

CASES = os.environ.get("ROBOT_IDENT_FUZZ", "2000")


def test_every_reader() -> None:
    folder = Path(__file__).resolve().parents[1] / "test" / "fuzz"
    command = [sys.executable, "-m", "pytest", str(folder), "-q", "-o", "faulthandler_timeout=0"]
    done = subprocess.run(command, env=os.environ | {"ROBOT_IDENT_FUZZ": CASES}, capture_output=True, text=True)
    print(f"\n{CASES} damaged files of each kind: {done.stdout.strip().splitlines()[-1]}")
    assert done.returncode == 0, done.stdout

"""`make demo`, twenty times in a row with other seeds: each finds what is hidden, none fails.

ROBOT_IDENT_DEMOS: how many times (20).
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rclpy")

DEMOS = int(os.environ.get("ROBOT_IDENT_DEMOS", "20"))
LIMIT = 1200.0  # s


def test_unattended(tmp_path: Path) -> None:
    seconds, failed = [], []
    for seed in range(DEMOS):
        folder = tmp_path / str(seed)
        command = [sys.executable, "-m", "robot_ident", "demo", "--json", "--folder", folder, "--seed", str(seed)]
        done = subprocess.run(command, capture_output=True, text=True, timeout=LIMIT, stdin=subprocess.DEVNULL)
        if done.returncode:
            failed.append(seed)
            print(f"  demo {seed:2d}: code {done.returncode}: {(done.stderr.strip().splitlines() or ['silent'])[-1]}")
            continue
        told = json.loads(done.stdout)
        found = [f"{item['effect']}@{item['joint']}" for item in told["diagnosis"]["missing"]]
        seconds.append(told["seconds"])
        print(
            f"  demo {seed:2d}: {told['seconds']:5.0f} s, {told['diagnosis']['verdict']}: {', '.join(found)}",
            flush=True,
        )
        assert Path(told["report"]).stat().st_size > 100_000
    if seconds:
        print(f"{len(seconds)} of {DEMOS} demos: median {np.median(seconds):.0f} s, longest {max(seconds):.0f} s")
    assert not failed, f"demos {failed} failed"

"""A thread that can't be interrupted ends with the process: Python doesn't take apart what it works with."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("rclpy")

NODE = """
import atexit, sys, time
from robot_ident.nodes.common import Abandoned, BaseNode, run

class Busy(BaseNode):
    node_name, description, table = "busy", "never done", ()

    def __init__(self):
        super().__init__()
        Abandoned(time.sleep, (600.0,), "busy").start()
        self.every(0.2, self.end)

atexit.register(print, "taken apart")
raise SystemExit(run(Busy, ["busy"]))
"""


def test_the_process_ends_at_once_and_whole(package: Path, tmp_path: Path) -> None:
    environment = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join([str(package.parent), *sys.path]),
        "ROS_DOMAIN_ID": str(1 + os.getpid() % 100),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        "ROS_LOG_DIR": str(tmp_path / "log"),
    }
    done = subprocess.run([sys.executable, "-c", NODE], env=environment, capture_output=True, text=True, timeout=90.0)
    assert done.returncode == 0, done.stderr
    assert "taken apart" not in done.stdout

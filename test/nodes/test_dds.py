"""A DDS client that is not ROS, of another make, reads the robot's state and commands it."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rclpy")

LOOPBACK = """<CycloneDDS><Domain Id="any">
<General><Interfaces><NetworkInterface name="lo" multicast="false"/></Interfaces>
<AllowMulticast>false</AllowMulticast></General>
<Discovery><ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>32</MaxAutoParticipantIndex>
<Peers><Peer address="127.0.0.1"/></Peers></Discovery></Domain></CycloneDDS>"""


@pytest.fixture
def foreign_python() -> Path:
    """Return the Python of the environment with cyclonedds."""
    path = Path(os.environ.get("ROBOT_IDENT_DDS_PYTHON", Path(sys.prefix) / "dds" / "bin" / "python"))
    if not path.exists():
        pytest.skip(f"{path} is missing: `make test` makes an environment with cyclonedds there")
    return path


@pytest.mark.long
def test_a_client_that_is_not_ros(start: Callable[..., Any], foreign_python: Path) -> None:
    robot = start("simulated_kuka", noise=0.0, initial_position="[0.1,0.0,0.0]")
    robot.says("kuka_ir361 with")
    own = {"PYTHONPATH", "LD_LIBRARY_PATH", "_ROS_WHEELS_BOOTSTRAP_COMPLETE", "AMENT_PREFIX_PATH"}
    environment = {name: value for name, value in os.environ.items() if name not in own}
    client = Path(__file__).with_name("dds_client.py")
    done = subprocess.run(
        [foreign_python, client, "0.4", "10"],
        env={**environment, "CYCLONEDDS_URI": LOOPBACK},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    seen = json.loads(done.stdout)
    assert seen["names"] == ["joint_1", "joint_2", "joint_3"]
    assert seen["received"] > 100 and seen["sent"] > 100
    assert seen["shortest_step_ms"] > 0.0, "no state came twice"
    np.testing.assert_allclose(seen["position"], [0.4, 0.0, 0.0], atol=2e-3)
    assert abs(seen["effort"][1]) > 1.0, "the robot carries itself"
    assert robot.end()[0] == 0, robot.text

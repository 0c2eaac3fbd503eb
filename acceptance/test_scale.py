"""Recordings of a hundred thousand to ten million messages: memory and time of `info`, `identify` and `diagnose`.

Run by `make acceptance PARTS=scale`. Memory is what the command and its workers hold beside the file itself, which
Linux reads through its page cache. ROBOT_IDENT_SCALE_MESSAGES (100000,1000000,10000000) and ROBOT_IDENT_SCALE_JOINTS
(3,7,12) choose the rows of the table; the largest bag takes 5 GB of disk.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import psutil
import pytest
import yaml

MESSAGES = [int(word) for word in os.environ.get("ROBOT_IDENT_SCALE_MESSAGES", "100000,1000000,10000000").split(",")]
JOINTS = [int(word) for word in os.environ.get("ROBOT_IDENT_SCALE_JOINTS", "3,7,12").split(",")]
RATE, PERIOD, BLOCK = 1000.0, 10.0, 100_000  # Hz, s, messages
MOST_IDENTIFY, MOST_DIAGNOSE = 4e9, 1e9  # bytes
ROWS_DIAGNOSE = 25_000


@dataclass(frozen=True)
class Used:
    """What a command took: processor and wall time [s], the largest memory beside its files [bytes]."""

    seconds: float
    memory: float


def write_robot(joints: int, folder: Path) -> Path:
    """Write a chain of links of .3 m whose axes turn by turn are vertical and horizontal; return its robot YAML."""
    parts = ['<robot name="chain"><link name="link_0"/>']
    for k in range(1, joints + 1):
        mass = 12.0 * 0.75**k
        inertia = " ".join(f'{key}="{0.02 * mass}"' for key in ("ixx", "iyy", "izz"))
        parts.append(
            f'<link name="link_{k}"><inertial><origin xyz="0.05 0.02 0.15"/><mass value="{mass}"/>'
            f'<inertia {inertia} ixy="0" ixz="0" iyz="0"/></inertial></link>'
            f'<joint name="joint_{k}" type="revolute"><parent link="link_{k - 1}"/><child link="link_{k}"/>'
            f'<origin xyz="0 0 {0.0 if k == 1 else 0.3}"/><axis xyz="{"0 0 1" if k % 2 else "0 1 0"}"/>'
            '<limit lower="-3" upper="3" velocity="4" effort="2000"/></joint>'
        )
    (folder / "chain.urdf").write_text("".join([*parts, "</robot>"]), encoding="utf-8")
    content = {
        "schema": "robot_ident/robot/1",
        "name": "chain",
        "urdf": "chain.urdf",
        "joints": {f"joint_{k}": {"velocity": 4.0, "acceleration": 20.0} for k in range(1, joints + 1)},
    }
    (folder / "chain.yaml").write_text(yaml.safe_dump(content), encoding="utf-8")
    return folder / "chain.yaml"


def write_bag(joints: int, messages: int, folder: Path, rate: float = RATE, seed: int = 0) -> Path:
    """Write a recording of the chain that repeats every 10 s, with viscous friction and noise, block by block."""
    import pinocchio as pin

    from robot_ident.bags import BagWriter, Series
    from robot_ident.bags.storage import JOINT_STATE, Topic

    model = pin.buildModelFromUrdf(str(folder / "chain.urdf"))
    data, rng = model.createData(), np.random.default_rng(seed)
    period = round(PERIOD * rate)
    t = np.arange(period) / rate
    q, dq, ddq = np.zeros((3, period, joints))
    for k in range(1, 6):
        w = 2.0 * np.pi * k / PERIOD
        a, b = 0.4 * rng.standard_normal((2, joints)) / k
        s, c = np.sin(w * t)[:, None], np.cos(w * t)[:, None]
        q, dq, ddq = q + a * s + b * c, dq + w * (a * c - b * s), ddq - w * w * (a * s + b * c)
    tau = np.array([pin.rnea(model, data, *row) for row in zip(q, dq, ddq, strict=True)]) + 3.0 * dq
    noise = 0.01 * np.std(tau, axis=0)
    names = tuple(f"joint_{k}" for k in range(1, joints + 1))
    path = folder / f"bag_{messages}"
    with BagWriter(path, [Topic("/joint_states", JOINT_STATE)], compress=False) as bag:
        for first in range(0, messages, BLOCK):
            number = np.arange(first, min(first + BLOCK, messages))
            phase = number % period
            for stamp, topic, row in Series(
                "/joint_states",
                names,
                1_700_000_000_000_000_000 + np.rint(number * 1e9 / rate).astype(np.int64),
                q[phase] + 1e-5 * rng.standard_normal((len(number), joints)),
                dq[phase],
                tau[phase] + noise * rng.standard_normal((len(number), joints)),
            ).messages():
                bag.write(topic, row, stamp)
    return path


def held(process: psutil.Process) -> int:
    """Return the bytes that a process and its children hold in memory of their own."""
    total = 0
    for one in [process, *process.children(recursive=True)]:
        try:
            status = Path(f"/proc/{one.pid}/status").read_text(encoding="utf-8")
        except OSError:
            continue
        total += sum(1024 * int(line.split()[1]) for line in status.splitlines() if line.startswith("RssAnon"))
    return total


def used_by(*words: str | Path) -> Used:
    """Run a verb; return what it took."""
    begun, memory = time.monotonic(), 0
    command = [sys.executable, "-m", "robot_ident", *map(str, words)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as popen:
        process = psutil.Process(popen.pid)
        while popen.poll() is None:
            memory = max(memory, held(process))
            time.sleep(0.02)
        told = popen.stdout.read() if popen.stdout else ""
    assert popen.returncode == 0, told
    return Used(time.monotonic() - begun, memory)


@pytest.mark.parametrize("joints", JOINTS)
def test_messages(joints: int, tmp_path: Path) -> None:
    robot = write_robot(joints, tmp_path)
    print(f"\n{joints} joints\n  messages    bag      info              identify")
    seconds: dict[int, Used] = {}
    for messages in MESSAGES:
        bag = write_bag(joints, messages, tmp_path)
        size = sum(file.stat().st_size for file in bag.iterdir())
        info = used_by("info", bag)
        model = tmp_path / f"model_{messages}.yaml"
        identify = used_by("identify", bag, "--robot", robot, "-o", model)
        print(
            f"  {messages:8d}  {size / 1e9:5.2f} GB  {info.seconds:5.1f} s {info.memory / 1e9:5.2f} GB"
            f"  {identify.seconds:6.1f} s {identify.memory / 1e9:5.2f} GB"
        )
        seconds[messages] = identify
        if joints <= 7:
            assert identify.memory < MOST_IDENTIFY
        arrays = 8.0 * messages * (2 * joints + 1)  # positions, efforts, times
        columns = 8.0 * 8.0 * messages  # eight numbers of every sample that are looked at together
        assert info.memory < 3e8 + 2.0 * arrays + columns, "info holds more than the arrays of the recording twice"
        for file in bag.iterdir():
            file.unlink()
    few, many = min(MESSAGES), max(MESSAGES)
    if many > few:
        assert seconds[many].seconds < 2.0 * many / few * seconds[few].seconds, "time grows faster than the messages"


def test_diagnosis_of_25000_rows(tmp_path: Path) -> None:
    robot = write_robot(6, tmp_path)
    bag = write_bag(6, 4 * ROWS_DIAGNOSE, tmp_path, rate=ROWS_DIAGNOSE / PERIOD)
    model = tmp_path / "model.yaml"
    used_by("identify", bag, "--robot", robot, "-o", model)
    found = used_by("diagnose", model, bag)
    print(f"\ndiagnose of {ROWS_DIAGNOSE} rows of 6 joints: {found.seconds:.0f} s, {found.memory / 1e9:.2f} GB")
    assert found.memory < MOST_DIAGNOSE

"""Sound files of every kind, and the process that reads what was made of them.

ROBOT_IDENT_FUZZ: cases a kind; without it a few, always the same ones.
"""

from __future__ import annotations

import json
import os
import select
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, Verbosity, settings

if TYPE_CHECKING:
    from test.conftest import ExactArm

CASES = int(os.environ.get("ROBOT_IDENT_FUZZ", "0"))
HANG = 60.0  # s; the largest of these files is read in less than one
COMMON = dict(deadline=None, database=None, print_blob=True, suppress_health_check=list(HealthCheck))
settings.register_profile(
    "quick",
    max_examples=12,
    derandomize=True,
    phases=(Phase.explicit, Phase.generate),
    verbosity=Verbosity.quiet,
    **COMMON,
)
settings.register_profile("long", max_examples=max(CASES, 1), **COMMON)
settings.load_profile("long" if CASES else "quick")

URDF = """<robot name="arm">
  <link name="base"><collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision></link>
  <link name="one"><inertial><origin xyz="0 0 0.1" rpy="0 0 0"/><mass value="2"/>
    <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>
    <collision><origin xyz="0 0 0.2"/><geometry><cylinder radius="0.03" length="0.3"/></geometry></collision></link>
  <link name="two"><inertial><mass value="1"/>
    <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>
    <collision><origin xyz="0 0 0.2"/><geometry><sphere radius="0.05"/></geometry></collision></link>
  <link name="three"><inertial><mass value="0.5"/>
    <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="joint_1" type="revolute"><origin xyz="0 0 0.1" rpy="0 0 0"/><parent link="base"/><child link="one"/>
    <axis xyz="0 0 1"/><limit lower="-2" upper="2" velocity="3" effort="100"/>
    <dynamics damping="1" friction="2"/></joint>
  <joint name="joint_2" type="continuous"><origin xyz="0 0 0.5" rpy="1.57 0 0"/>
    <parent link="one"/><child link="two"/><axis xyz="0 1 0"/></joint>
  <joint name="joint_3" type="prismatic"><origin xyz="0 0 0.5"/><parent link="two"/><child link="three"/>
    <axis xyz="1 0 0"/><limit lower="0" upper="0.5" velocity="1" effort="50"/></joint>
  <transmission name="t"><joint name="joint_1"/>
    <actuator name="m"><mechanicalReduction>50</mechanicalReduction></actuator></transmission>
</robot>
"""


class Reader:
    """A worker process; one that dies or hangs is an error of the file that it was reading, and is begun anew."""

    def __init__(self, sound: Path) -> None:
        self.sound = sound
        self.process: subprocess.Popen[str] | None = None

    def _begin(self) -> subprocess.Popen[str]:
        worker = Path(__file__).with_name("fuzz_worker.py")
        self.process = subprocess.Popen(
            [sys.executable, str(worker), str(self.sound)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            bufsize=1,
            env=os.environ | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
        )
        assert self._line(self.process) == ["ready", ""]
        return self.process

    def _line(self, process: subprocess.Popen[str]) -> list[str]:
        assert process.stdout is not None
        if not select.select([process.stdout], [], [], HANG)[0]:
            self.end()
            pytest.fail(f"no answer within {HANG:g} s")
        line = process.stdout.readline()
        if not line:
            self.process = None
            pytest.fail(f"the reader died with code {process.wait()}")
        return list(json.loads(line))

    def read(self, target: str, path: Path) -> str:
        """Return the text of our own error, empty where the file is good enough; fail on anything else."""
        process = self.process or self._begin()
        assert process.stdin is not None
        print(json.dumps([target, str(path)]), file=process.stdin, flush=True)
        outcome, text = self._line(process)
        if outcome == "broken":
            pytest.fail(text)
        return text

    def end(self) -> None:
        if self.process is not None:
            self.process.kill()
            self.process.wait()
            self.process = None


@pytest.fixture(scope="session")
def sound(tmp_path_factory: pytest.TempPathFactory, arm: ExactArm) -> Path:
    """Return a folder with a sound file of every kind, each named after its target."""
    folder = tmp_path_factory.mktemp("sound")
    _bags(folder)
    _tables(folder, arm)
    _texts(folder, arm)
    return folder


def _bags(folder: Path) -> None:
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    from robot_ident.bags import JOINT_STATE, BagWriter, Topic
    from robot_ident.bags.cdr import serialise

    stamps = 1_700_000_000_000_000_000 + 5_000_000 * np.arange(60)
    values = np.random.default_rng(0).normal(size=(3, 60, 3))
    rows = serialise(("joint_1", "joint_2", "joint_3"), stamps, *values)
    messages = [(stamp, row.tobytes()) for stamp, row in zip(stamps.tolist(), rows, strict=True)]
    for name, compression in (("plain", None), ("none", "NONE"), ("zstd", "ZSTD"), ("lz4", "LZ4")):
        _write_mcap(folder / f"bag-{name}.mcap", messages, compression)
    with BagWriter(folder / "bag-folder", [Topic("/joint_states", JOINT_STATE)]) as bag:
        for log, data in messages:
            bag.write("/joint_states", data, log)
    for name, plugin, mode in (("db3", "SQLITE3", "NONE"), ("mcap.zstd", "MCAP", "FILE")):
        writer = Writer(folder / "made", version=9, storage_plugin=StoragePlugin[plugin])
        writer.set_compression(CompressionMode[mode], CompressionFormat.ZSTD)
        with writer:
            topic = writer.add_connection("/joint_states", JOINT_STATE, typestore=get_typestore(Stores.ROS2_JAZZY))
            for log, data in messages:
                writer.write(topic, log, data)
        shutil.move(next((folder / "made").glob(f"*.{name}")), folder / f"bag-rosbags.{name}")
        shutil.rmtree(folder / "made")


def _write_mcap(path: Path, messages: list[tuple[int, bytes]], compression: str | None) -> None:
    """Write without checksums, which would keep damage from being looked at."""
    from mcap.writer import CompressionType, Writer

    text = URDF.encode() + b"\0"
    with path.open("wb") as file:
        kind = CompressionType[compression or "NONE"]
        writer = Writer(file, 4000, kind, use_chunking=compression is not None, enable_crcs=False)
        writer.start("ros2", "test")
        for topic, message, content in (
            ("/robot_description", "std_msgs/msg/String", [(1, b"\0\1\0\0" + len(text).to_bytes(4, "little") + text)]),
            ("/joint_states", "sensor_msgs/msg/JointState", messages),
        ):
            schema = writer.register_schema(message, "ros2msg", b"")
            channel = writer.register_channel(topic, "cdr", schema, {"offered_qos_profiles": "- depth: 3"})
            for number, (log, data) in enumerate(content):
                writer.add_message(channel, log, data, log, number)
        writer.finish()


def _tables(folder: Path, arm: ExactArm) -> None:
    from robot_ident.bags import write_recording

    recording = arm.record(periods=2, rate=50.0, lead=0.0)
    write_recording(folder / "table-arm.csv", recording)
    write_recording(folder / "table-arm.npz", recording)


def _texts(folder: Path, arm: ExactArm) -> None:
    from robot_ident.configuration import to_yaml
    from robot_ident.estimation.identify import identify
    from robot_ident.model.model_file import write_model
    from robot_ident.provenance import config_file
    from robot_ident.testbed.scenario import Scenario, seal
    from robot_ident.trajectories.excitation import Excitation
    from robot_ident.trajectories.fourier_series import FourierSeries
    from robot_ident.trajectories.point_to_point import PointToPoint

    write_model(identify([arm.record(periods=4)], arm.robot), folder / "model.yaml")
    small = FourierSeries(0.1, np.zeros(3), 0.2 * arm.series.a, 0.2 * arm.series.b)
    excitation = Excitation("kuka_ir361", arm.robot.joints, small, 150.0)
    (folder / "excitation.yaml").write_text(to_yaml(excitation.to_dict()))
    points = np.array([[0.0, 0.1, 0.2], [0.3, -0.1, 0.1], [0.1, 0.0, -0.2]])
    PointToPoint("kuka_ir361", arm.robot.joints, points, np.ones(3), np.ones(3)).write(
        folder / "excitation-points.yaml"
    )
    (folder / "robot-spring.yaml").write_text(config_file("robots", "kuka_ir361_spring.yaml").read_text())
    shutil.copy(config_file("robots", "kuka_ir361_spring.urdf"), folder)
    (folder / "urdf-arm.urdf").write_text(URDF)
    answer = {"kind": "single", "seed": 3, "robot": "kuka_ir361", "effects": ("stribeck@joint_2:x=1",)}
    (folder / "sealed.sealed").write_text(seal(Scenario(**answer, background=(), visible_rms=(0.1, 2.0, 0.3))))


@pytest.fixture(scope="session")
def reader(sound: Path) -> Iterator[Reader]:
    """Return the reader of all tests."""
    made = Reader(sound)
    yield made
    made.end()


@pytest.fixture
def place(tmp_path: Path, sound: Path) -> Path:
    """Return a folder for the cases of a test, with what robot YAMLs name beside them."""
    shutil.copy(sound / "kuka_ir361_spring.urdf", tmp_path)
    return tmp_path

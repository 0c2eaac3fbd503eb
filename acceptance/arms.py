"""Arms of six and seven axes at a tenth of the KUKA's torque: links of example_robot_data, drives and noise of size."""

from __future__ import annotations

import sys
from pathlib import Path

import yaml

URDF = {
    "ur5": "ur_description/urdf/ur5_joint_limited_robot.urdf",
    "panda": "panda_description/urdf/panda.urdf",
}
JOINTS = {
    "ur5": [f"{j}_joint" for j in ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")],
    "panda": [f"panda_joint{k}" for k in range(1, 8)],
}
WRIST = {"ur5": 3, "panda": 4}
"""From which joint on drives are small."""


def write_arm(name: str, folder: Path) -> Path:
    """Write the robot YAML of an arm; return it. FileNotFoundError without the wheel of example-robot-data.

    Reflected rotors have .1 kg m^2, 1e-5 behind a gear of 101; where no link's inertia takes one up, the model has its
    own parameter of it.
    """
    large = {"gear_ratio": 101.0, "armature": 0.1, "torque_variance": 4.0, "position_variance": 1e-9}
    small = {"gear_ratio": 101.0, "armature": 0.1, "torque_variance": 0.4, "position_variance": 1e-9}
    drives = {
        joint: {**(large if k < WRIST[name] else small), "velocity": 1.5, "acceleration": 5.0}
        for k, joint in enumerate(JOINTS[name])
    }
    friction = {joint: 3.0 if k < WRIST[name] else 0.8 for k, joint in enumerate(JOINTS[name])}
    content = {
        "schema": "robot_ident/robot/1",
        "name": name,
        "urdf": str(_robots() / URDF[name]),
        "joints": drives,
        "workspace": [],
        "effects": [f"rotor_inertia@{joint}" for joint in JOINTS[name]],
        "simulation": {"viscous": dict(friction), "coulomb": dict(friction)},
    }
    folder.mkdir(parents=True, exist_ok=True)
    file = folder / f"{name}.yaml"
    file.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
    return file


def _robots() -> Path:
    for base in map(Path, sys.path):
        folder = base / "cmeel.prefix/share/example-robot-data/robots"
        if folder.is_dir():
            return folder
    raise FileNotFoundError("example-robot-data is not installed (pip install '.[test]')")

"""robot_ident: optimal excitation of robots, identification with uncertainty, and doubt about what the model lacks.

>>> from robot_ident import Robot, identify, read_recording
>>> model = identify([read_recording("recording")], Robot.load("kuka_ir361"))  # doctest: +SKIP
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

__version__ = "0.1.0"

_HOME = {
    "Excitation": "trajectories.excitation",
    "Model": "model.model",
    "Recording": "recording.recording",
    "Robot": "robot.robot",
    "diagnose": "diagnosis.diagnose",
    "identify": "estimation.identify",
    "read_recording": "bags.read",
    "validate": "estimation.validation",
    "write_recording": "bags.bag_writer",
}

__all__ = list(_HOME)


def __getattr__(name: str) -> Any:
    """Import a name when it is first used, so that `import robot_ident` costs nothing."""
    if name not in _HOME:
        raise AttributeError(f"module 'robot_ident' has no attribute {name!r}")
    return getattr(import_module(f"robot_ident.{_HOME[name]}"), name)


def __dir__() -> list[str]:
    return sorted([*globals(), *_HOME])

"""Reads files that may be anything, in a process of its own: within a gigabyte, one after the other.

A line on standard input names a target and a path; a line on standard output says what came of it: `fine`, `refused`
with our own error's text, or `broken` with the traceback of anything else. Every warning counts as broken.
"""

from __future__ import annotations

import json
import resource
import sys
import tempfile
import traceback
import warnings
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

from robot_ident.errors import RobotIdentError

GIGABYTE = 1 << 30
MEMORY = "/dev/shm" if Path("/dev/shm").is_dir() else None  # where syncing costs nothing
LONGEST = 2000  # characters of a line that a user still reads


def bag(path: Path) -> None:
    """Every question that is asked of a bag; one that is refused keeps none of the others from being asked."""
    from robot_ident.bags import describe, joint_states, read_messages, read_recording, read_robot_description, recover

    def singly() -> Any:
        with patch.object(joint_states, "_MOST_LAYOUTS", 0):
            return read_recording(path)

    with tempfile.TemporaryDirectory(dir=MEMORY) as scratch:
        answers: list[Callable[[], Any]] = [
            lambda: describe(path),
            lambda: read_recording(path),
            singly,
            lambda: sum(len(message.data) for message in read_messages(path)),
            lambda: recover(path, Path(scratch) / "mended"),
            lambda: describe(Path(scratch) / "mended"),
            lambda: read_robot_description(path),
        ]
        refused: list[RobotIdentError] = []
        for answer in answers:
            try:
                answer()
            except RobotIdentError as error:
                check_line(error)
                refused.append(error)
    if len(refused) == len(answers):
        raise refused[0]


def large(path: Path) -> None:
    """What every verb asks of a bag."""
    from robot_ident.bags import describe, read_recording

    describe(path)
    read_recording(path)


def table(path: Path) -> None:
    """A table is read, and what was read is measured and predicted from."""
    from robot_ident.bags import describe, read_recording, write_recording
    from robot_ident.estimation.prediction import predict
    from robot_ident.recording import process
    from robot_ident.robot import load_robot

    describe(path)
    recording = read_recording(path)
    with tempfile.TemporaryDirectory(dir=MEMORY) as scratch:
        write_recording(Path(scratch) / "bag", recording)
        write_recording(Path(scratch) / "table.csv", recording)
    process(recording, load_robot())
    predict(_model(), recording)


@cache
def _model() -> Any:
    from robot_ident.model.model_file import read_model

    return read_model(Path(sys.argv[1]) / "model.yaml")


def robot(path: Path) -> None:
    """A robot is read, with all that is derived from it when it is first used."""
    from robot_ident.model.structure import Structure
    from robot_ident.robot import load_robot

    made = load_robot(path)
    Structure.build(made)
    if made.geometry is not None:
        made.geometry.shapes  # noqa: B018


def urdf(path: Path) -> None:
    """A URDF is what a robot is made of, and what `init` drafts a robot YAML from."""
    from robot_ident.robot.urdf import read_inventory

    refused = None
    try:
        read_inventory(path.read_text(encoding="utf-8", errors="replace"), path)
    except RobotIdentError as error:
        check_line(error)
        refused = error
    robot(path)
    if refused is not None:
        raise refused


def excitation(path: Path) -> None:
    """A motion is read and certified for the robot that it names."""
    from robot_ident.limits.certifier import certify
    from robot_ident.robot import load_robot
    from robot_ident.trajectories.excitation import Excitation
    from robot_ident.trajectories.point_to_point import load_motion

    motion = load_motion(path)
    if isinstance(motion, Excitation):
        certify(motion, load_robot())
    else:
        motion.reference(np.linspace(0.0, motion.duration, 50))


def model(path: Path) -> None:
    """A model is read, and is written again as it was read."""
    from robot_ident.configuration import to_yaml
    from robot_ident.model.model_file import is_model, read_model

    is_model(path)
    to_yaml(read_model(path).to_dict())


def sealed(path: Path) -> None:
    """The answer of a sealed file is opened and understood."""
    from robot_ident.testbed.scenario import open_sealed

    open_sealed(path)


TARGETS = {"bag": bag, "large": large, "table": table, "robot": robot, "urdf": urdf}
TARGETS |= {"excitation": excitation, "model": model, "sealed": sealed}


def check_line(error: RobotIdentError) -> None:
    """Assert that an error is one line that a user can read."""
    text = str(error)
    assert text and text.isprintable(), f"not one line: {text!r}"
    assert len(text) <= LONGEST, f"{len(text)} characters: {text[:200]} ..."


def answer(target: str, path: Path) -> tuple[str, str]:
    """Return what came of reading a file."""
    try:
        TARGETS[target](path)
    except RobotIdentError as error:
        try:
            check_line(error)
        except AssertionError:
            return "broken", traceback.format_exc()
        return "refused", str(error)
    except BaseException:
        return "broken", traceback.format_exc()
    return "fine", ""


def warm_up(folder: Path) -> None:
    """Read the sound files once, so that what libraries take at their first use isn't counted as a reader's."""
    for file in sorted(folder.iterdir()):
        target = file.name.partition(".")[0].partition("-")[0]
        if target in TARGETS:
            outcome, text = answer(target, file)
            assert outcome == "fine", f"{file}: {text}"


def main() -> None:
    warnings.simplefilter("error")
    warm_up(Path(sys.argv[1]))
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    limit = pages * resource.getpagesize() + GIGABYTE
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    print(json.dumps(["ready", ""]), flush=True)
    for line in sys.stdin:
        target, path = json.loads(line)
        print(json.dumps(answer(target, Path(path))), flush=True)


if __name__ == "__main__":
    main()

"""Ten arms of the example-robot-data wheel, as a user meets them: a URDF and nothing else."""

from __future__ import annotations

import io
import json
import re
import sys
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any

ARMS: dict[str, tuple[str, int]] = {
    "ur3": ("ur_description/urdf/ur3_joint_limited_robot.urdf", 6),
    "ur5": ("ur_description/urdf/ur5_joint_limited_robot.urdf", 6),
    "ur10": ("ur_description/urdf/ur10_joint_limited_robot.urdf", 6),
    "panda": ("panda_description/urdf/panda.urdf", 7),
    "jaco": ("kinova_description/robots/kinova.urdf", 6),
    "z1": ("z1_description/urdf/z1.urdf", 6),
    "xarm7": ("xarm_description/urdf/xarm7.urdf", 7),
    "so100": ("so_arm_description/urdf/so100.urdf", 5),
    "so101": ("so_arm_description/urdf/so101.urdf", 5),
    "talos_left_arm": ("talos_data/robots/talos_left_arm.urdf", 6),
}
"""Name: file in the wheel, axes."""

ACCELERATION = 5.0
"""What no URDF holds and `init` is told, rad/s^2."""


def urdf_of(arm: str) -> Path:
    """Return an arm's URDF. FileNotFoundError without the wheel."""
    for base in map(Path, sys.path):
        folder = base / "cmeel.prefix/share/example-robot-data/robots"
        if folder.is_dir():
            return folder / ARMS[arm][0]
    raise FileNotFoundError("example-robot-data is not installed (pip install '.[test]')")


def with_limits(text: str) -> tuple[str, int]:
    """Return a drafted robot YAML with the limits filled in that its URDF lacks, and how many lines that took."""
    lines, edited = text.splitlines(), 0
    for place, line in enumerate(lines):
        found = re.match(r"(\s*)# (position|velocity|torque): \S.*# MISSING", line)
        if found:
            value = {"position": "[-3.0, 3.0]", "velocity": "1.0", "torque": "50"}[found[2]]
            lines[place] = f"{found[1]}{found[2]}: {value}"
            edited += 1
    assert "MISSING" not in "\n".join(lines[1:]), "nothing but limits is left to fill in"
    return "\n".join(lines) + "\n", edited


def whole_way(arm: str, folder: Path, *, seconds: float, periods: int = 6) -> dict[str, Any]:
    """Take an arm from its URDF to a validated model by the command line; return what came of it.

    seconds: of search for each of two motions. Keys: axes, edited (lines of limits), parameters, relative (error of
    the torque on the second motion, by joint), margin (least room of the designed motions, as `design` says it).
    """
    robot, first, second = (folder / name for name in ("arm.yaml", "x_1.yaml", "x_2.yaml"))
    _run("init", "--urdf", urdf_of(arm), "--acceleration", ACCELERATION, "--name", arm, "-o", robot)
    text, edited = with_limits(robot.read_text(encoding="utf-8"))
    robot.write_text(text, encoding="utf-8")
    for seed, motion in enumerate((first, second), 1):
        _run(
            "design", "--robot", robot, "--seed", seed, "--starts", 1, "--time-limit", seconds,
            "--accept-unchecked", "-o", motion,
        )  # fmt: skip
        _run("simulate", motion, "--robot", robot, "--periods", periods, "-o", folder / f"run_{seed}")
    _run("check", first, "--robot", robot, "--accept-unchecked")
    model = folder / "model.yaml"
    identified = _run("identify", folder / "run_1", "--robot", robot, "-o", model, "--json")
    validated = _run("validate", model, folder / "run_2", "--json")
    relative = {joint: fit["relative"] for joint, fit in validated["residual"].items()}
    return {
        "axes": len(relative),
        "edited": edited,
        "parameters": len(identified["parameters"]),
        "relative": relative,
    }


def _run(*words: object) -> dict[str, Any]:
    """Run a verb as a user would; return its JSON where it was asked for."""
    from robot_ident.cli.main import main

    out = io.StringIO()
    with redirect_stdout(out):
        code = main([str(word) for word in words])
    assert code == 0, f"{' '.join(map(str, words))}: exit code {code}\n{out.getvalue()}"
    return dict(json.loads(out.getvalue())) if "--json" in words else {}

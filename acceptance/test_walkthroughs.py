"""The walkthroughs with drivers' bags, from raw bag to compiled function, every command of their pages as it stands."""

from __future__ import annotations

import io
import re
import shlex
import subprocess
import sys
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

import numpy as np
import pytest
from drivers import Course, franka_at_work, ur10e_at_work

CHECKOUT = Path(__file__).resolve().parents[1]
MOST_LINES = 5
"""Of YAML by hand."""

PROGRAM = """#include <stdio.h>
#include "{name}.h"
int main(void) {{
  double x[3 * {n}], tau[{n}];
  for (;;) {{
    for (int k = 0; k < 3 * {n}; ++k) if (scanf("%lf", x + k) != 1) return 0;
    {name}_torque(x, x + {n}, x + 2 * {n}, tau);
    for (int k = 0; k < {n}; ++k) printf("%.17g ", tau[k]);
    printf("\\n");
  }}
}}
"""


def robots() -> Path:
    for base in map(Path, sys.path):
        folder = base / "cmeel.prefix/share/example-robot-data/robots"
        if folder.is_dir():
            return folder
    return pytest.skip("the example-robot-data wheel is not installed")


def run(words: list[str]) -> str:
    """Run a command of a page; return all that it said."""
    from robot_ident.cli.main import main

    out = io.StringIO()
    with redirect_stdout(out), redirect_stderr(out):
        code = main(words)
    assert code == 0, f"{shlex.join(words)}:\n{out.getvalue()}"
    return out.getvalue()


def walk(page: str, edits: list[Callable[[str], int]]) -> tuple[dict[str, str], int]:
    """Run the commands of a page; at each of its YAML blocks the next edit is made with its text.

    Return what every verb said last, and how many lines were written by hand.
    """
    said, lines, text = {}, 0, (CHECKOUT / "docs" / page).read_text(encoding="utf-8")
    waiting = iter(edits)
    for kind, block in re.findall(r"^```(sh|yaml)\n(.*?)^```", text, re.MULTILINE | re.DOTALL):
        if kind == "yaml":
            lines += next(waiting)(block)
            continue
        for line in block.splitlines():
            words = shlex.split(line)
            said[words[1]] = run(words[1:])
    return said, lines


def line_in_place_of(key: str, file: str = "arm.yaml") -> Callable[[str], int]:
    """Return an edit that writes a block in place of the line of a key."""

    def edit(block: str) -> int:
        path = Path(file)
        text, count = re.subn(rf"^{key}:.*\n", block, path.read_text(encoding="utf-8"), flags=re.MULTILINE)
        assert count == 1
        path.write_text(text, encoding="utf-8")
        return len(block.splitlines())

    return edit


def line_below(key: str) -> Callable[[str], int]:
    """Return an edit that writes a block below the line of a key."""

    def edit(block: str) -> int:
        path = Path("arm.yaml")
        path.write_text(path.read_text(encoding="utf-8").replace(f"{key}:\n", f"{key}:\n{block}"), encoding="utf-8")
        return len(block.splitlines())

    return edit


def new_file(name: str) -> Callable[[str], int]:
    """Return an edit that writes a block as a file."""

    def edit(block: str) -> int:
        Path(name).write_text(block, encoding="utf-8")
        return len(block.splitlines())

    return edit


def error_of_compiled(course: Course) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return rms [n] Nm of the compiled torque's error along a course that no fit has seen, of that torque, and of the
    noise of one of its samples.

    Speeds and accelerations are those that a controller would ask for: the smooth course's own.
    """
    from scipy.signal import savgol_filter

    (header,) = Path("controller").glob("*.h")
    n = course.q.shape[1]
    Path("controller/main.c").write_text(PROGRAM.format(name=header.stem, n=n))
    words = ["cc", "-std=c99", "-O2", "-Wall", "-Werror", "main.c", f"{header.stem}.c", "-o", "main", "-lm"]
    subprocess.run(words, cwd="controller", check=True, timeout=120)
    dt = float(course.t[1] - course.t[0])
    width = 2 * round(0.06 / dt) + 1
    q, dq, ddq = (savgol_filter(course.q, width, 4, deriv=order, delta=dt, axis=0) for order in range(3))
    every = slice(width, -width, max(1, round(0.01 / dt)))
    moving = np.all(np.abs(dq[every]) > 0.05, axis=1)
    rows = np.hstack([part[every][moving] for part in (q, dq, ddq)])
    text = "\n".join(" ".join(map(repr, map(float, row))) for row in rows)
    done = subprocess.run(["./main"], cwd="controller", input=text, capture_output=True, text=True, check=True)
    found = np.array([line.split() for line in done.stdout.splitlines()], dtype=float)
    whole = savgol_filter(course.tau, width, 2, axis=0)
    smooth, noise = whole[every][moving], np.std(course.tau - whole, axis=0)
    error, size = (np.sqrt(np.mean(part**2, axis=0)) for part in (found - smooth, smooth))
    return error, size, noise


def test_ur10e(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    fresh = ur10e_at_work(tmp_path, robots())
    edits = [
        line_in_place_of("effort"),
        new_file("loaded.conditions.yaml"),
        line_below("  wrist_3_joint"),
    ]
    said, lines = walk("walkthrough_ur10e.md", edits)
    assert lines <= MOST_LINES
    assert "cycles" in said["info"]
    assert "current" in said["info"]
    first, _, _ = said["diagnose"].partition("\n")
    assert first in (
        "missing: cable@shoulder_pan_joint",
        "missing: cable@shoulder_pan_joint (or end_stop@shoulder_pan_joint)",
    ), "the hose, straight or stretched from some angle on, and nothing else"
    error, size, noise = error_of_compiled(fresh)
    print(
        f"\nUR10e: {lines} lines by hand, error of the compiled torque {np.round(error, 3)} Nm of {np.round(size, 2)}"
    )
    assert np.all(error < np.maximum(0.1 * size, noise)), "a tenth of the torque, or what one sample's noise hides"


def test_franka(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    fresh = franka_at_work(tmp_path, robots())
    said, lines = walk("walkthrough_franka.md", [line_in_place_of("effort")])
    assert lines <= MOST_LINES
    assert "panda_finger_joint1" in said["init"]
    first, _, _ = said["diagnose"].partition("\n")
    assert first in (
        "missing: cable@panda_joint1",
        "missing: cable@panda_joint1 (or end_stop@panda_joint1)",
    ), "the hose, straight or stretched from some angle on, and nothing else"
    error, size, noise = error_of_compiled(fresh)
    print(
        f"\nFranka: {lines} lines by hand, error of the compiled torque {np.round(error, 3)} Nm of {np.round(size, 2)}"
    )
    assert np.all(error < np.maximum(0.1 * size, noise)), "a tenth of the torque, or what one sample's noise hides"

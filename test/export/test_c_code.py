"""The C code, compiled: the model's torque where nothing is smoothed, smooth through standstill, whole programs."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from robot_ident.effects import load_effects
from robot_ident.errors import InputError
from robot_ident.export.to_c import to_c
from robot_ident.model.model import Model
from robot_ident.robot import Robot, load_robot
from robot_ident.signals.motion import Motion

Make = Callable[..., Model]
PROGRAM = """#include <stdio.h>
#include "{name}.h"
int main(void) {{
  double x[3 * {n}], tau[3][{n}];
  for (;;) {{
    for (int k = 0; k < 3 * {n}; ++k) if (scanf("%lf", x + k) != 1) return 0;
    {name}_torque(x, x + {n}, x + 2 * {n}, tau[0]);
    {name}_gravity(x, tau[1]);
    {name}_friction(x, x + {n}, tau[2]);
    for (int k = 0; k < 3 * {n}; ++k) printf("%.17g ", tau[k / {n}][k % {n}]);
    printf("\\n");
  }}
}}
"""

pytestmark = pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")


LOADED = """
from robot_ident.effects import Coefficient, Effect

class Loaded(Effect):
    name, meaning, equation = "loaded", "a step with the load", "a load / |load|"
    coefficients = (Coefficient("level", "Nm", "N"),)
    symmetry, signature, uses_torque = "dissipative", "steps with the load", True

    def full_terms(self, x, m):
        load = x.load[self.joint]
        return [{self.joint: load / m.sqrt(load * load)}]
"""


def run(model: Model, motion: Motion, folder: Path, smoothing: float = 0.01) -> np.ndarray:
    """Return torque, gravity and friction [3, N, n] of the compiled code; any warning is an error."""
    made = to_c(model, smoothing)
    for file, text in made.files.items():
        (folder / file).write_text(text)
    name = next(file.removesuffix(".h") for file in made.files if file.endswith(".h"))
    (folder / "main.c").write_text(PROGRAM.format(name=name, n=model.robot.n))
    words = [
        "cc",
        "-std=c99",
        "-O1",
        "-Wall",
        "-Wextra",
        "-pedantic",
        "-Werror",
        "main.c",
        f"{name}.c",
        "-o",
        "main",
        "-lm",
    ]
    subprocess.run(words, cwd=folder, check=True, timeout=120)
    rows = np.hstack([motion.q, motion.dq, motion.ddq])
    text = "\n".join(" ".join(map(repr, map(float, row))) for row in rows)
    done = subprocess.run(["./main"], cwd=folder, input=text, capture_output=True, text=True, check=True, timeout=60)
    return (
        np.array([line.split() for line in done.stdout.splitlines()], dtype=float)
        .reshape(-1, 3, model.robot.n)
        .transpose(1, 0, 2)
    )


def fast(n: int) -> Motion:
    q, v, a = np.random.default_rng(0).uniform(-1.0, 1.0, (3, 40, n))
    return Motion(q, np.sign(v) * (0.05 + np.abs(v)), 4.0 * a)


def test_compiled_torque_is_the_models(make: Make, tmp_path: Path) -> None:
    robot = load_robot("kuka_ir361_spring")
    structure = make(robot, ["stribeck@joint_2", "load_friction@joint_3", "rotor_inertia@joint_3"])
    values = structure.values.copy()
    values[25:] = np.where(values[25:] == 0.0, 0.3, values[25:])  # the effects that the simulated robot lacks
    model = make(robot, ["stribeck@joint_2", "load_friction@joint_3", "rotor_inertia@joint_3"], values)
    motion = fast(3)
    torque, gravity, friction = run(model, motion, tmp_path)
    np.testing.assert_allclose(torque, model.predict(motion), atol=1e-9)
    still = Motion(motion.q, 0 * motion.q, 0 * motion.q)
    np.testing.assert_allclose(gravity, model.predict(still), atol=1e-9)
    steady = Motion(motion.q, motion.dq, 0 * motion.q)
    links = model.structure.rigid_columns(steady) - model.structure.rigid_columns(still)
    rubbing = model.predict(steady) - model.predict(still) - links @ model.linear[:15]
    np.testing.assert_allclose(friction, rubbing, atol=1e-9)


def test_dry_friction_passes_smoothly_through_standstill(arm: Any, make: Make, tmp_path: Path) -> None:
    model = make(arm.robot)
    v = np.linspace(-0.05, 0.05, 201)[:, None] * np.ones(3)
    _, _, friction = run(model, Motion(0 * v, v, 0 * v), tmp_path, smoothing=0.02)
    dry = friction - v * model.linear[15:18]
    coulomb = model.linear[18:21]
    np.testing.assert_allclose(
        dry[np.abs(v[:, 0]) >= 0.02 + 1e-9], np.sign(v[np.abs(v[:, 0]) >= 0.02 + 1e-9]) * coulomb
    )
    assert np.all(np.diff(dry, axis=0) >= -1e-12)
    slope = np.diff(dry, axis=0) / 5e-4 / coulomb
    assert slope.max() == pytest.approx(1.5 / 0.02, rel=0.01)
    np.testing.assert_allclose(dry[100], 0.0, atol=1e-12)


def test_memory_is_left_out_and_said(arm: Any, make: Make, tmp_path: Path) -> None:
    label = "presliding@joint_1"
    made = to_c(make(arm.robot, [label]), 0.01)
    assert made.left == (label,)
    plain, torque = make(arm.robot), run(make(arm.robot, [label]), fast(3), tmp_path)[0]
    np.testing.assert_allclose(torque, plain.predict(fast(3)), atol=1e-9)


def test_a_torque_that_is_no_number_at_rest_is_refused(arm: Any, make: Make, tmp_path: Path) -> None:
    """A controller starts at rest, where the direction of a load may be 0 / 0."""
    (tmp_path / "loaded.py").write_text(LOADED)
    loaded = load_effects(tmp_path / "loaded.py")["loaded"](arm.robot, 0)
    model = make(arm.robot, [loaded])
    with pytest.raises(InputError, match=r"the torque of joint_1 at rest is not a number \(loaded@joint_1\)"):
        to_c(replace(model, values=np.ones(len(model.values))), 0.01)


NAMES = {
    "my__arm": "my_arm",
    "ur-5": "ur_5",
    "_Arm_": "arm",
    "7": "robot_7",
    "int": "int",
    "while": "while",
    "math": "robot_math",
    "float": "robot_float",
    "Größe 2": "gr_e_2",
    "腕": "robot",
    "a */ b /* c": "a_b_c",
    "two\nlines \\": "two_lines",
}


@pytest.mark.parametrize(("name", "in_c"), NAMES.items())
def test_any_name_of_a_robot_compiles(name: str, in_c: str, gantry: Robot, make: Make, tmp_path: Path) -> None:
    model = make(replace(gantry, name=name))
    assert sorted(to_c(model, 0.01).files) == [f"{in_c}.c", f"{in_c}.h"]
    np.testing.assert_allclose(run(model, fast(2), tmp_path)[0], model.predict(fast(2)), atol=1e-9)


def test_prismatic_joints_and_odd_names(gantry: Robot, make: Make, tmp_path: Path) -> None:
    model = make(replace(gantry, name="7 axis-gantry"))
    assert sorted(to_c(model, 0.01).files) == ["robot_7_axis_gantry.c", "robot_7_axis_gantry.h"]
    np.testing.assert_allclose(run(model, fast(2), tmp_path)[0], model.predict(fast(2)), atol=1e-9)

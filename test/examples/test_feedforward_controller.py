"""The example controller: its loop, compiled with the exported C, does what its header says; its files agree.

Without ROS 2's headers the plugin itself is compiled against stand-ins that declare what it uses of ros2_control.
"""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

from robot_ident.export.to_c import to_c
from robot_ident.model.model import Fit, Model, NoiseLevel
from robot_ident.signals.motion import Motion

pytestmark = pytest.mark.skipif(shutil.which("g++") is None, reason="no C++ compiler")

STRICT = ["-std=c++17", "-Wall", "-Wextra", "-Wpedantic", "-Werror"]
PROGRAM = """
#include <cstdio>
#include "feedforward_controller/model.hpp"
using namespace feedforward_controller;
using Core = Feedforward<kJoints>;
int main() {
  Core core(kTorque, kGravity);
  Core::Settings settings;
  double period, x[5][kJoints];
  for (auto * v : {&settings.kp, &settings.kd, &settings.limit})
    for (double & value : *v) if (std::scanf("%lf", &value) != 1) return 1;
  if (std::scanf("%lf", &settings.ramp) != 1) return 1;
  core.start(settings);
  while (std::scanf("%lf", &period) == 1) {
    for (auto & row : x) for (double & value : row) if (std::scanf("%lf", &value) != 1) return 1;
    std::array<Core::Vector, 5> in;
    for (int k = 0; k < 5; ++k) std::copy(x[k], x[k] + kJoints, in[k].begin());
    Core::Vector tau;
    const Outcome outcome = core.update(in[0], in[1], in[2], in[3], in[4], period, tau);
    std::printf("%d %.17g", static_cast<int>(outcome), core.share());
    for (double value : tau) std::printf(" %.17g", value);
    std::printf("\\n");
  }
}
"""


@pytest.fixture(scope="module")
def folder(checkout: Path) -> Path:
    return checkout / "examples/feedforward_controller"


@pytest.fixture(scope="module")
def model(arm: Any) -> Model:
    structure = arm.structure
    values = structure.true_values()
    noise = NoiseLevel((None,) * 3, (None,) * 3, 1, 1)
    fits = {joint: Fit(0.0, 0.0, None, 0.0) for joint in arm.robot.joints}
    return Model(structure, values, np.zeros((len(values),) * 2), "wls", noise, fits, 1.0, 0.0)


@pytest.fixture(scope="module")
def built(folder: Path, model: Model, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the exported model, the filled-in header and the compiled loop."""
    out = tmp_path_factory.mktemp("controller")
    for name, text in to_c(model, 0.01).files.items():
        (out / name).write_text(text)
    name = model.robot.name
    filled = (folder / "include/feedforward_controller/model.hpp.in").read_text()
    (out / "feedforward_controller").mkdir()
    (out / "feedforward_controller/model.hpp").write_text(
        filled.replace("@MODEL@", name).replace("@MODEL_UPPER@", name.upper())
    )
    (out / "main.cpp").write_text("#include <algorithm>\n" + PROGRAM)
    include = ["-I", str(folder / "include"), "-I", str(out)]
    subprocess.run(["cc", "-std=c99", "-O1", "-c", f"{name}.c", "-o", "model.o"], cwd=out, check=True, timeout=120)
    words = ["g++", *STRICT, "-O1", *include, "main.cpp", "model.o", "-o", "main", "-lm"]
    subprocess.run(words, cwd=out, check=True, timeout=120)
    return out


def cycles(built: Path, rows: np.ndarray, *, kp: float, kd: float, limit: float, ramp: float) -> np.ndarray:
    """Return outcome, share and tau of every cycle: rows are period, q_r, dq_r, ddq_r, q, dq."""
    head = [*[kp] * 3, *[kd] * 3, *[limit] * 3, ramp]
    text = " ".join(map(repr, map(float, head))) + "\n" + "\n".join(" ".join(map(repr, map(float, r))) for r in rows)
    done = subprocess.run(["./main"], cwd=built, input=text, capture_output=True, text=True, check=True, timeout=60)
    return np.array([line.split() for line in done.stdout.splitlines()], dtype=float)


def states(count: int) -> tuple[Motion, np.ndarray]:
    q, v, a = np.random.default_rng(0).uniform(-1.0, 1.0, (3, count, 3))
    v = np.sign(v) * (0.05 + np.abs(v))
    return Motion(q, v, 2.0 * a), np.hstack([np.full((count, 1), 0.002), q, v, 2.0 * a, q, v])


def test_on_the_path_it_is_the_models_torque(built: Path, model: Model) -> None:
    motion, rows = states(30)
    found = cycles(built, rows, kp=500.0, kd=50.0, limit=1e4, ramp=0.0)
    assert np.all(found[:, 0] == 0)
    np.testing.assert_allclose(found[:, 2:], model.predict(motion), atol=1e-9)


def test_beside_the_path_feedback_leads_back(built: Path, model: Model) -> None:
    motion, rows = states(10)
    rows[:, 10:13] -= 0.01
    rows[:, 13:16] += 0.1
    found = cycles(built, rows, kp=500.0, kd=50.0, limit=1e4, ramp=0.0)
    still = 0.0 * motion.q
    weight = [model.predict(Motion(q, still, still)) for q in (motion.q - 0.01, motion.q)]
    expected = model.predict(motion) + weight[0] - weight[1] + 500.0 * 0.01 - 50.0 * 0.1
    np.testing.assert_allclose(found[:, 2:], expected, atol=1e-9)


def test_it_comes_in_over_the_ramp_with_the_weight_at_once(built: Path, model: Model) -> None:
    motion, rows = states(1)
    found = cycles(built, np.repeat(rows, 600, axis=0), kp=0.0, kd=0.0, limit=1e4, ramp=1.0)
    np.testing.assert_allclose(found[:, 1], np.minimum(1.0, 0.002 * np.arange(1, 601)), atol=1e-12)
    weight = model.predict(Motion(motion.q, 0.0 * motion.q, 0.0 * motion.q))[0]
    np.testing.assert_allclose(found[0, 2:], weight + 0.002 * (model.predict(motion)[0] - weight), atol=1e-9)
    steps = np.abs(np.diff(found[:, 2:], axis=0)).max()
    assert steps <= 0.0021 * np.abs(model.predict(motion)[0] - weight).max()


def test_what_is_no_number_holds_the_arm(built: Path, model: Model) -> None:
    motion, rows = states(3)
    rows[1, 5] = np.nan
    rows[2, 11] = np.inf
    found = cycles(built, rows, kp=500.0, kd=50.0, limit=1e4, ramp=0.0)
    assert found[:, 0].tolist() == [0, 2, 2]
    weight = model.predict(Motion(motion.q, 0.0 * motion.q, 0.0 * motion.q))[1]
    np.testing.assert_allclose(found[1, 2:], weight - 50.0 * rows[1, 13:16], atol=1e-9)
    assert np.all(found[2, 2:] == 0.0), "where the state itself is unknown there is nothing to hold by"


def test_torque_keeps_its_limit(built: Path) -> None:
    _, rows = states(20)
    found = cycles(built, rows, kp=500.0, kd=50.0, limit=5.0, ramp=0.0)
    assert np.abs(found[:, 2:]).max() == 5.0
    assert np.all(found[np.any(np.abs(found[:, 2:]) == 5.0, axis=1), 0] == 1)


def test_the_files_agree(folder: Path) -> None:
    name = ElementTree.parse(folder / "package.xml").getroot().findtext("name")
    plugin = ElementTree.parse(folder / f"{name}.xml").getroot()
    entry = plugin.find("class")
    assert entry is not None
    source = (folder / f"src/{name}.cpp").read_text()
    kinds = re.search(r"PLUGINLIB_EXPORT_CLASS\(\s*([\w:]+),\s*([\w:]+)\)", source)
    assert kinds
    assert (entry.get("type"), entry.get("base_class_type")) == kinds.groups()
    assert plugin.get("path") == name
    assert entry.get("name") in (folder / "config/controllers.yaml").read_text()
    depends = {node.text for node in ElementTree.parse(folder / "package.xml").getroot().findall("depend")}
    cmake = (folder / "CMakeLists.txt").read_text()
    listed = re.search(r"set\(dependencies\s+([^)]*)\)", cmake)
    assert listed
    assert set(listed[1].split()) | {"rclcpp_lifecycle"} == depends
    for include in re.findall(r'#include "(\w+)/', source + (folder / f"include/{name}/{name}.hpp").read_text()):
        assert include in depends | {name}


def test_the_plugin_compiles_against_what_it_uses(folder: Path, built: Path, checkout: Path) -> None:
    """Stand-ins of ros2_control's headers, as of Jazzy, hold its types to what the plugin expects of them."""
    include = [
        "-I",
        str(checkout / "test/examples/ros2_control_stand_in"),
        "-I",
        str(folder / "include"),
        "-I",
        str(built),
    ]
    words = ["g++", *STRICT, "-fsyntax-only", *include, str(folder / "src/feedforward_controller.cpp")]
    done = subprocess.run(words, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr

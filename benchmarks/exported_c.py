"""How long the exported C code takes for one torque, and how far it is from Python: `python benchmarks/exported_c.py`.

The model is that of a seven-axis arm with viscous and Coulomb friction, with the values of its URDF; the functions are
called one after the other on 2,000 random states, 100 times over, and the processor time of a call is printed.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from robot_ident.export.to_c import to_c
from robot_ident.model.model import Fit, Model, NoiseLevel
from robot_ident.model.structure import Structure
from robot_ident.robot import load_robot
from robot_ident.signals.motion import Motion

STATES, ROUNDS = 2000, 100
SMOOTHING = 0.01  # rad/s; the states are faster, so that nothing is smoothed
PANDA = "panda_description/urdf/panda.urdf"
PROGRAM = """#include <stdio.h>
#include <stdlib.h>
#include <time.h>
#include "{name}.h"
int main(void) {{
  static double x[{states}][3 * {n}], tau[{n}];
  for (int k = 0; k < {states} * 3 * {n}; ++k) if (scanf("%lf", &x[0][0] + k) != 1) return 1;
  for (int k = 0; k < {states}; ++k) {{
    {name}_torque(x[k], x[k] + {n}, x[k] + 2 * {n}, tau);
    for (int j = 0; j < {n}; ++j) printf("%.17g ", tau[j]);
    printf("\\n");
  }}
  double sum = 0.0;
  clock_t begin = clock();
  for (int round = 0; round < {rounds}; ++round)
    for (int k = 0; k < {states}; ++k) {{
      {name}_torque(x[k], x[k] + {n}, x[k] + 2 * {n}, tau);
      sum += tau[0];
    }}
  double seconds = (double)(clock() - begin) / CLOCKS_PER_SEC;
  fprintf(stderr, "%.6g %.3g\\n", seconds / {rounds} / {states} * 1e6, sum);
  return 0;
}}
"""


def arm() -> Model:
    """Return the model of a Panda with the gripper held."""
    for base in map(Path, sys.path):
        urdf = base / "cmeel.prefix/share/example-robot-data/robots" / PANDA
        if urdf.is_file():
            break
    else:
        raise SystemExit("example-robot-data is not installed (pip install '.[test]')")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "panda.yaml"
        joints = ", ".join(f"panda_joint{k}: {{}}" for k in range(1, 8))
        path.write_text(
            f"schema: robot_ident/robot/1\nname: panda\nurdf: {urdf}\njoints: {{{joints}}}\n"
            "self_collision: {check: false}\n",
            encoding="utf-8",
        )
        robot = load_robot(path)
    structure = Structure.build(robot)
    values = structure.true_values()
    values = np.where(values == 0.0, 0.5, values)  # friction, of which the URDF says nothing
    p = len(values)
    nothing = {joint: Fit(0.0, 0.0, None, 0.0) for joint in robot.joints}
    noise = NoiseLevel((None,) * robot.n, (None,) * robot.n, 1, 1)
    return Model(structure, values, np.zeros((p, p)), "wls", noise, nothing, 1.0, 0.0)


def main() -> None:
    """Print time and error."""
    if shutil.which("cc") is None:
        raise SystemExit("a C compiler (cc) is needed")
    model = arm()
    n = model.robot.n
    q, v, a = np.random.default_rng(0).uniform(-1.0, 1.0, (3, STATES, n))
    motion = Motion(q, np.sign(v) * (0.05 + np.abs(v)), 4.0 * a)
    with tempfile.TemporaryDirectory() as folder:
        for file, text in to_c(model, SMOOTHING).files.items():
            (Path(folder) / file).write_text(text, encoding="utf-8")
        program = PROGRAM.format(name="panda", n=n, states=STATES, rounds=ROUNDS)
        (Path(folder) / "main.c").write_text(program, encoding="utf-8")
        subprocess.run(["cc", "-std=c99", "-O2", "main.c", "panda.c", "-o", "main", "-lm"], cwd=folder, check=True)
        rows = np.hstack([motion.q, motion.dq, motion.ddq])
        text = "\n".join(" ".join(map(repr, map(float, row))) for row in rows)
        done = subprocess.run(["./main"], cwd=folder, input=text, capture_output=True, text=True, check=True)
    found = np.array([line.split() for line in done.stdout.splitlines()], dtype=float)
    error = float(np.abs(found - model.predict(motion)).max())
    microseconds = float(done.stderr.split()[0])
    print(
        f"{n} axes, {len(model.linear)} parameters: {microseconds:.2f} us a torque, at most {error:.1e} Nm from Python"
    )


if __name__ == "__main__":
    main()

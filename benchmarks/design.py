"""How good the excitations get, and how fast: the tables of the paper and beyond, each design a process of its own.

    python benchmarks/design.py [ROW...] [--seeds 0:10] [--time-limit S] [--bound] [--keep FOLDER]

Rows: d-optimal, condition, spring, spring-condition, ur10, panda (all, unless some are named). `seconds` is wall time
from the start of the process to its end, Python's imports included. The arms come from example-robot-data.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from robot_ident.design.target import Target
from robot_ident.limits.certifier import Certifier
from robot_ident.paper.printed import CONDITION, LOG10_DET
from robot_ident.robot import load_robot
from robot_ident.robot.robot import Robot
from robot_ident.trajectories.excitation import Excitation
from robot_ident.trajectories.fourier_series import FourierSeries

_RANDOM = 200  # random feasible motions that an arm's design is measured by


@dataclass(frozen=True)
class Row:
    """One row of the table: a robot, what is asked for, and what the paper has or what is to be reached."""

    robot: str
    criterion: str
    time_limit: float
    paper: str
    aim: str
    arm: dict[str, Any] = field(default_factory=dict)


ROWS = {
    "d-optimal": Row(
        "kuka_ir361", "d-optimal", 60.0, f"det {LOG10_DET['d-optimal']:.2f}", "det -50.52 for 8 of 10, -50 for all"
    ),
    "condition": Row(
        "kuka_ir361",
        "condition",
        90.0,
        f"condition {CONDITION['condition']}, det {LOG10_DET['condition']:.2f}",
        "condition 3.2, det no worse than the paper's",
    ),
    "spring": Row("kuka_ir361_spring", "d-optimal", 60.0, "det -55.73, condition 111.7", "det -57"),
    "spring-condition": Row(
        "kuka_ir361_spring", "condition", 90.0, "condition 47.3, det -45.28", "condition 45, det no worse"
    ),
    "ur10": Row(
        "ur10",
        "d-optimal",
        120.0,
        "peers: minutes to hours",
        "feasible, 5 decades over random",
        {
            "urdf": "ur_description/urdf/ur10_robot.urdf",
            "joints": [
                f"{j}_joint" for j in ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
            ],
            "variances": (25.0, 25.0, 9.0, 1.0, 1.0, 1.0),
            "position": (-3.0, 3.0),
            "end_effector": "ee_link",
        },
    ),
    "panda": Row(
        "panda",
        "d-optimal",
        120.0,
        "peers: minutes to hours",
        "feasible, 5 decades over random",
        {
            "urdf": "panda_description/urdf/panda.urdf",
            "joints": [f"panda_joint{k}" for k in range(1, 8)],
            "variances": (4.0, 4.0, 4.0, 4.0, 0.3, 0.3, 0.3),
            "position": None,
            "end_effector": "panda_link8",
        },
    ),
}


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("rows", nargs="*", metavar="ROW", help=", ".join(ROWS))
    parser.add_argument("--seeds", default="0:10", metavar="A:B", help="of the KUKA's d-optimal and condition rows")
    parser.add_argument("--time-limit", type=float, metavar="S", help="instead of each row's own")
    parser.add_argument("--bound", action="store_true", help="with the D-efficiency (it shares the time limit)")
    parser.add_argument("--keep", metavar="FOLDER", help="where the excitations stay")
    args = parser.parse_args()
    if unknown := set(args.rows) - set(ROWS):
        parser.error(f"no row {', '.join(sorted(unknown))}; there are {', '.join(ROWS)}")
    first, last = (int(word) for word in args.seeds.split(":"))
    header = ["row", "seed", "log10 det", "condition", "seconds", "paper", "to reach"]
    if args.bound:
        header.insert(4, "D-efficiency")
    print("| " + " | ".join(header) + " |\n|" + "---|" * len(header), flush=True)
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(args.keep or scratch)
        folder.mkdir(parents=True, exist_ok=True)
        for name in args.rows or ROWS:
            row = ROWS[name]
            seeds = [first] if row.arm or row.robot != "kuka_ir361" else range(first, last)
            for seed in seeds:
                for line in run(name, row, seed, args.time_limit or row.time_limit, folder, bound=args.bound):
                    print("| " + " | ".join(line) + " |", flush=True)


def run(name: str, row: Row, seed: int, limit: float, folder: Path, *, bound: bool) -> Iterator[Sequence[str]]:
    """Yield the lines of one design; its check is another process, which ends with 3 where a limit is not kept."""
    robot = str(write_arm(row, folder)) if row.arm else row.robot
    file = folder / f"{name}_{seed}.yaml"
    words = [
        "design",
        "--robot",
        robot,
        "--criterion",
        row.criterion,
        "--seed",
        str(seed),
        "--time-limit",
        f"{limit:g}",
    ]
    started = time.perf_counter()
    done = call(*words, *(["--bound"] if bound else []), "-o", str(file), "--force", "--json")
    seconds = time.perf_counter() - started
    if done.returncode:
        yield [name, str(seed), done.stderr.strip(), "", *([""] if bound else []), f"{seconds:.1f}", row.paper, row.aim]
        return
    found = json.loads(done.stdout)
    kept = call("check", str(file), "--robot", robot).returncode == 0
    aim = row.aim if kept else f"{row.aim}; NOT CERTIFIED"
    det = f"{found['log10_det_covariance']:.2f}"
    if row.arm:
        det += f" ({random_det(load_robot(robot)) - found['log10_det_covariance']:.1f} decades over random)"
    efficiency = [f"{found['bound']['d_efficiency']:.0%}"] if bound else []
    yield [name, str(seed), det, f"{found['condition_number']:.2f}", *efficiency, f"{seconds:.1f}", row.paper, aim]


def call(*words: str) -> subprocess.CompletedProcess[str]:
    """Run a verb in a process of its own."""
    return subprocess.run([sys.executable, "-m", "robot_ident", *words], capture_output=True, text=True)


def write_arm(row: Row, folder: Path) -> Path:
    """Write the robot YAML of an arm from the example-robot-data wheel."""
    arm = row.arm
    base = next(
        (p for p in (Path(entry) / "cmeel.prefix/share/example-robot-data/robots" for entry in sys.path) if p.is_dir()),
        None,
    )
    if base is None:
        sys.exit("the example-robot-data wheel is not installed: pip install 'robot_ident[test]'")
    lines = [f"schema: robot_ident/robot/1\nname: {row.robot}\nurdf: {base / arm['urdf']}"]
    lines.append(f"end_effector: {arm['end_effector']}\njoints:")
    position = f"position: {list(arm['position'])}, " if arm["position"] else ""
    for joint, variance in zip(arm["joints"], arm["variances"], strict=True):
        lines.append(f"  {joint}: {{{position}velocity: 1.5, acceleration: 5.0, torque_variance: {variance}}}")
    lines.append("workspace:\n  - {kind: half_space, normal: [0, 0, 1], offset: 0.1}")
    path = folder / f"{row.robot}.yaml"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def random_det(robot: Robot) -> float:
    """Return log10 det of the best among random motions as large as the joints' limits allow that are certified."""
    rng, certifier, target = np.random.default_rng(0), Certifier(robot), Target.of_robot(robot)
    limits, best = robot.limits, np.inf
    for _ in range(_RANDOM):
        q0 = limits.lower + (limits.upper - limits.lower) * rng.uniform(0.2, 0.8, robot.n)
        a, b = rng.normal(size=(2, robot.n, 5))
        q, dq, ddq = FourierSeries(0.1, q0, a, b).extremes()
        room = np.minimum((limits.upper - q0) / (q.upper - q0), (q0 - limits.lower) / (q0 - q.lower))
        share = np.minimum.reduce([room, limits.velocity / dq.largest, limits.acceleration / ddq.largest])
        for factor in (0.99, 0.6, 0.3):
            series = FourierSeries(0.1, q0, factor * share[:, None] * a, factor * share[:, None] * b)
            excitation = Excitation(robot.name, robot.joints, series, 150.0)
            if certifier.keeps(excitation):
                best = min(best, target.judge([excitation]).log10_det_covariance)
                break
    return best


if __name__ == "__main__":
    main()

"""Process time of `robot_ident identify` on 16 periods of 3 axes, 24,000 messages and the approach, from the MCAP.

    OMP_NUM_THREADS=1 python benchmarks/identify.py [--repeat 3]

Each line is a process of its own, the start of Python included; user and system time, which other work on the machine
inflates little, and the least of a few runs. The simulated robot makes the bag first.
"""

from __future__ import annotations

import argparse
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from robot_ident.bags import write_recording
from robot_ident.planning.blends import Playback
from robot_ident.robot import load_robot
from robot_ident.testbed.simulation import simulate
from robot_ident.trajectories.excitation import Excitation
from robot_ident.trajectories.fourier_series import FourierSeries

PERIODS = 16


def write_bag(path: Path) -> int:
    """Write the recording; return its number of messages."""
    robot = load_robot()
    a, b = 0.12 * np.random.default_rng(1).normal(size=(2, robot.n, 5))
    excitation = Excitation(robot.name, robot.joints, FourierSeries(0.1, np.array([0.0, 0.2, -0.3]), a, b), 150.0)
    played = Playback(excitation, robot, PERIODS)
    made = simulate(robot, played, steady=(played.transient, excitation.period, PERIODS), seed=1)
    write_recording(path, made.recording)
    return made.recording.samples


def process_time(words: list[str]) -> float:
    """Return the user and system time [s] of a process that must succeed."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([sys.executable, "-m", "robot_ident", *words], check=True, capture_output=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def main() -> None:
    """Print a line for each estimator."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repeat", type=int, default=3, help="runs of which the fastest counts")
    repeat = parser.parse_args().repeat
    with tempfile.TemporaryDirectory() as room:
        bag = Path(room) / "recording"
        print(f"{write_bag(bag)} messages of 3 axes")
        for estimator in ("wls", "ml"):
            words = ["identify", str(bag), "--estimator", estimator, "-o", str(Path(room) / "model.yaml"), "--force"]
            print(f"identify --estimator {estimator}: {min(process_time(words) for _ in range(repeat)):.2f} s")


if __name__ == "__main__":
    main()

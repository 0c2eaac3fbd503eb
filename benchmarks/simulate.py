"""How much faster than real time the simulated robot is: 16 periods of 10 s after a transient, construction included.

Usage: OMP_NUM_THREADS=1 python benchmarks/simulate.py [ROBOT]
"""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass

import numpy as np

from robot_ident.robot import load_robot
from robot_ident.signals.motion import Array, Motion
from robot_ident.testbed.phenomena.phenomenon import home_pose
from robot_ident.testbed.simulation import simulate
from robot_ident.trajectories.fourier_series import FourierSeries

PERIODS, PERIOD = 16, 10.0


@dataclass(frozen=True)
class Excitation:
    """A Fourier series that starts from rest: its amplitude grows smoothly over the transient."""

    series: FourierSeries
    duration: float = (1 + PERIODS) * PERIOD

    @property
    def start_pose(self) -> Array:
        """Pose at rest [n]."""
        return self.reference(np.zeros(1)).q[0]

    def reference(self, t: Array) -> Motion:
        """Return s(t) (x(t) - x0) + x0 with s = x^3 (10 - 15 x + 6 x^2), x = t / PERIOD."""
        m, x = self.series.motion(t), np.clip(t / PERIOD, 0.0, 1.0)[:, None]
        s, ds = x**3 * (10 - 15 * x + 6 * x**2), 30 * x**2 * (1 - x) ** 2 / PERIOD
        dds = 60 * x * (1 - x) * (1 - 2 * x) / PERIOD**2
        q = m.q - self.series.q0
        return Motion(self.series.q0 + s * q, s * m.dq + ds * q, s * m.ddq + 2 * ds * m.dq + dds * q)


def main() -> None:
    """Print wall time and ratio for each way to simulate."""
    robot = load_robot(sys.argv[1] if len(sys.argv) > 1 else "kuka_ir361")
    rng = np.random.default_rng(0)
    a, b = rng.normal(0.0, 0.3, (2, robot.n, 5))
    reference = Excitation(FourierSeries(1 / PERIOD, home_pose(robot), a, b))
    steady = (PERIOD, PERIOD, PERIODS)
    cases = {
        "feedforward": {"steady": steady},
        "pd": {"steady": steady, "servo": "pd"},
        "feedforward, anti-alias filter": {"steady": steady, "anti_alias": True},
        "feedforward, every period": {},
        "pd, every period": {"servo": "pd"},
    }
    simulate(robot, Excitation(reference.series, 0.1), anti_alias=True)  # the libraries are loaded now
    for name, options in cases.items():
        start = time.perf_counter()
        result = simulate(robot, reference, **options)  # type: ignore[arg-type]
        wall = time.perf_counter() - start
        length = result.recording.duration
        print(f"{robot.name}, {name}: {length:.0f} s in {wall:.2f} s, {length / wall:.0f} times faster than real time")


if __name__ == "__main__":
    main()

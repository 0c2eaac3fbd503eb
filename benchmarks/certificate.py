"""Does anything break its limits between the points at which it was proven to keep them?

    python benchmarks/certificate.py [--robot kuka_ir361] [--trajectories 200] [--seed 0] [--denser 100]

Draws random trajectories, makes each as large as the certificate allows (so that its limits are close), and searches
position, velocity, acceleration, workspace rules, torque and the distance between links on a grid 100 times denser than
the certificate's own first intervals. The last column counts margins that the dense grid finds below what was proven: 0
is right.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass, field

import numpy as np

from robot_ident.limits.certifier import Certifier
from robot_ident.limits.feasibility import allowed_poses, rule_margins
from robot_ident.limits.self_collision import LinkPairs, link_pairs
from robot_ident.limits.torque_bound import TorqueModel
from robot_ident.robot import Robot, load_robot
from robot_ident.signals.motion import Array
from robot_ident.trajectories.excitation import Excitation
from robot_ident.trajectories.fourier_series import FourierSeries

INTERVALS = 64  # of the certificate at its start
HARMONICS = 5
BASE_FREQUENCY = 0.1
_WIDTH = 15
ROUNDING = 1e-9  # of the dense search itself, as a share of the limit (of a metre)


@dataclass
class Tally:
    """What was found for one kind of limit."""

    certificates: int = 0
    violations: int = 0
    below: int = 0  # dense margins smaller than the proven ones
    tightest: float = np.inf
    gap: list[float] = field(default_factory=list)


def largest_certified(robot: Robot, certifier: Certifier, rng: np.random.Generator, pose: Array) -> Excitation | None:
    """Return a random trajectory about a pose, as large as bisection finds it certified, or None."""
    a, b = rng.normal(size=(2, robot.n, HARMONICS))
    order = np.arange(1, HARMONICS + 1)
    a, b = a / np.sqrt(order), b / np.sqrt(order)
    low, high, best = 0.0, 4.0, None
    for _ in range(12):
        size = 0.5 * (low + high)
        series = FourierSeries(BASE_FREQUENCY, pose, size * a, size * b)
        tried = Excitation(robot.name, robot.joints, series, 150.0)
        if certifier.keeps(tried):
            low, best = size, tried
        else:
            high = size
    return best


def dense_margins(excitation: Excitation, robot: Robot, points: int, links: LinkPairs | None) -> dict[str, Array]:
    """Return the smallest margin of every limit on a dense grid, by quantity, as arrays over joints or rules."""
    motion, limits = excitation.series.motion(np.linspace(0.0, excitation.period, points)), robot.limits
    out = {"position": np.minimum(motion.q - limits.lower, limits.upper - motion.q).min(axis=0)}
    out["velocity"] = (limits.velocity - np.abs(motion.dq)).min(axis=0)
    out["acceleration"] = (limits.acceleration - np.abs(motion.ddq)).min(axis=0)
    if robot.workspace:
        out["workspace"] = rule_margins(robot, motion.q).min(axis=0)
    model = TorqueModel(robot)
    if model.known:
        found = (limits.torque - np.abs(model.torque(motion))).min(axis=0)
        out["torque"] = found[np.isfinite(limits.torque)]
    if links is not None and robot.geometry is not None:
        nearest = min(links.closest(q)[0] for q in motion.q)
        out["self_collision"] = np.array([nearest - robot.geometry.clearance])
    return out


def main() -> None:
    """Draw, certify, search, print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robot", default="kuka_ir361", help="name, robot YAML or URDF")
    parser.add_argument("--trajectories", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--denser", type=int, default=100, help="points for each of the certificate's intervals")
    options = parser.parse_args()
    robot, rng = load_robot(options.robot), np.random.default_rng(options.seed)
    certifier, links = Certifier(robot), link_pairs(robot)[0]
    poses = allowed_poses(robot, options.trajectories, seed=options.seed)
    tallies: dict[str, Tally] = {}
    spent, drawn, done = 0.0, 0, 0
    while done < options.trajectories:
        excitation = largest_certified(robot, certifier, rng, poses[drawn % len(poses)])
        drawn += 1
        if excitation is None:
            continue
        done += 1
        began = time.process_time()
        margins = certifier.margins(excitation)
        spent += time.process_time() - began
        proven: dict[str, list[float]] = {}
        for item in margins.items:
            proven.setdefault(item.quantity, []).append(item.margin)
        for quantity, found in dense_margins(excitation, robot, INTERVALS * options.denser, links).items():
            tally, stated = tallies.setdefault(quantity, Tally()), np.array(proven[quantity])
            tally.certificates += len(found)
            tally.violations += int(np.sum(found <= 0.0))
            tally.below += int(np.sum(found < stated - ROUNDING))
            tally.tightest = min(tally.tightest, float(stated.min()))
            tally.gap += (found - stated).tolist()
    print(f"{robot.name}: {done} certified trajectories, {1e3 * spent / done:.0f} ms of CPU for all margins of one")
    print(f"dense search: {INTERVALS * options.denser} points a period")
    head = ("limit", "certificates", "violations", "below the proof", "tightest proven", "largest slack")
    print("  ".join(name.ljust(_WIDTH) for name in head))
    for quantity, tally in tallies.items():
        cells = (quantity, tally.certificates, tally.violations, tally.below)
        numbers = (f"{tally.tightest:.3g}", f"{max(tally.gap):.2g}")
        print("  ".join(str(cell).ljust(_WIDTH) for cell in (*cells, *numbers)))
    if any(tally.violations or tally.below for tally in tallies.values()):
        raise SystemExit("a limit was broken between the points")


if __name__ == "__main__":
    main()

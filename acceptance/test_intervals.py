"""Intervals of 50 robots each of which hides an effect: as often as they say, they hold what all motions agree on.

ROBOT_IDENT_INTERVAL_CASES: robots (50). Each is identified from three random motions without the effect; what its
parameters come to is what twelve motions without noise agree on.
"""

from __future__ import annotations

import os
from functools import cache, partial

import numpy as np
import pytest
from table import FIRST_SEED

from robot_ident.estimation.identify import estimate
from robot_ident.model.structure import Structure
from robot_ident.parallel import completed
from robot_ident.recording import Processing, process
from robot_ident.robot import load_robot
from robot_ident.testbed.calibrate import standard_motions
from robot_ident.testbed.phenomena import plant_physics
from robot_ident.testbed.scenario import draw_scenario
from robot_ident.testbed.simulation import Play

ROBOTS = int(os.environ.get("ROBOT_IDENT_INTERVAL_CASES", "50"))
MOTIONS, FITTED = 12, 3
QUIET = 1e-3  # of the noise's variance
WAYS = {"periods": (8, 0.1, Processing()), "one pass": (2, 0.1, Processing(periodic=False, low_pass=10.0))}
"""Periods recorded, share of the robot's noise, processing."""


def _errors(seed: int, way: str) -> list[list[float]]:
    """Return errors over sigma [p]: counting what is missing, and of noise alone."""
    robot, rng = load_robot(), np.random.default_rng(seed)
    structure, hidden = Structure.build(robot), draw_scenario(seed, robot, kinds=["single"]).effects
    physics = plant_physics(robot, hidden)
    motions = standard_motions(robot, 2 * MOTIONS)
    plays = [Play.of(robot, physics, motions[k]) for k in rng.permutation(len(motions))[:MOTIONS]]
    clean = [process(play.record(4, noise=QUIET, seed=100 * seed + k), robot) for k, play in enumerate(plays)]
    agreed = estimate(clean, structure).values
    periods, noise, processing = WAYS[way]
    recordings = [play.record(periods, noise=noise, seed=100 * seed + 50 + k) for k, play in enumerate(plays[:FITTED])]
    model = estimate([process(one, robot, processing) for one in recordings], structure, processing=processing)
    error = model.values - agreed
    return [(error / np.sqrt(np.diag(spread))).tolist() for spread in (model.covariance, model.by_noise)]


@cache
def outcomes(way: str) -> np.ndarray:
    found = dict(completed(partial(_errors, way=way), list(range(FIRST_SEED, FIRST_SEED + ROBOTS))))
    errors = np.array([found[seed] for seed in sorted(found)])
    print(f"\n{way}: {ROBOTS} robots, 95 % intervals hold what all motions agree on")
    for k, name in enumerate(("counting what is missing", "of noise alone")):
        inside = np.abs(errors[:, k]) < 1.96
        rms = np.sqrt(np.mean(errors[:, k] ** 2))
        print(
            f"  {name:<26} {100 * inside.mean():.1f} %, least robot {100 * inside.mean(1).min():.0f} %, rms {rms:.2f}"
        )
    return errors


@pytest.mark.parametrize(("way", "least"), [("periods", 0.90), ("one pass", 0.85)])
def test_they_hold_as_often_as_they_say(way: str, least: float) -> None:
    assert np.mean(np.abs(outcomes(way)[:, 0]) < 1.96) >= least

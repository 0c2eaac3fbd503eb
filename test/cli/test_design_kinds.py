"""`design --validation-motion` and `design --criterion crlb --iterate`."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from robot_ident.design.target import Target
from robot_ident.limits.certifier import certify
from robot_ident.robot import load_robot
from robot_ident.trajectories.excitation import Excitation
from robot_ident.trajectories.point_to_point import load_motion

Run = Callable[..., Any]


def test_a_validation_motion_stops_at_20_points_with_the_largest_acceleration(run: Run, tmp_path: Path) -> None:
    file = tmp_path / "validation.yaml"
    made = run("design", "--validation-motion", "--seed", 4, "-o", file, "--json").json
    motion, robot = load_motion(file), load_robot()
    assert made["validation"] == {"points": 20, "duration": pytest.approx(motion.duration)}
    assert certify(motion, robot).kept
    t = np.arange(0.0, motion.duration, 1e-3)
    moved = motion.reference(t)
    np.testing.assert_allclose(motion.reference(motion.stops).dq, 0.0, atol=1e-6)
    assert np.all(np.max(np.abs(moved.dq), axis=0) <= robot.limits.velocity)
    np.testing.assert_allclose(np.max(np.abs(moved.ddq) / robot.limits.acceleration), 1.0, rtol=1e-6)
    assert run("simulate", file, "-o", tmp_path / "validation.npz").code == 0
    other = run("design", "--validation-motion", "--seed", 5, "--json").json
    assert other["validation"]["duration"] != made["validation"]["duration"]
    refused = run("design", "--validation-motion", "--harmonics", 3, "--bound")
    assert refused.code == 2
    assert "--harmonics, --bound" in refused.err


@pytest.mark.long
def test_the_bound_falls_from_round_to_round_until_no_motion_is_better(run: Run, tmp_path: Path) -> None:
    file = tmp_path / "last.yaml"
    words = ("design", "--criterion", "crlb", "--iterate", "--harmonics", 2, "--starts", 1, "-o", file, "--json")
    made = run(*words).json
    told = made["iterations"]
    assert told["converged"]
    first, *rest = told["rounds"]
    assert first["criterion"] == "condition"
    assert rest
    for before, after in zip(told["rounds"], rest, strict=False):
        assert after["criterion"] == "crlb"
        assert after["fall"] >= 0.02  # the stop rule
        assert after["log10_det_bound"] < before["log10_det_bound"]
    # the motion that is written is the last that was measured; at the truth its bound is what the last round says
    robot = load_robot()
    target = Target.of_robot(robot)
    exact = Target(
        target.structure, target.torque_variance, target.position_variance, 16, target.structure.true_values(), True
    )
    at_truth = exact.judge([Excitation.read(file)], bound=True).log10_det_covariance
    assert at_truth == pytest.approx(rest[-1]["log10_det_bound"], abs=0.5)
    assert run("check", file).code == 0


@pytest.mark.parametrize(
    ("words", "named"),
    [(("--iterate",), "--criterion crlb"), (("--criterion", "crlb", "--iterate", "--symmetric"), "--symmetric")],
)
def test_an_iteration_refuses_what_it_would_not_heed(run: Run, words: tuple[str, ...], named: str) -> None:
    refused = run("design", *words)
    assert refused.code == 2
    assert named in refused.err

"""Trials of the base model alone: recordings are what they are said to be, and a stopped trial goes on."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio
import pytest
from scipy.signal import butter, filtfilt

from robot_ident.robot import load_robot
from robot_ident.testbed.base_trial import BaseOutcome, base_summary
from robot_ident.testbed.like_real import KINDS, like_real

Verb = Callable[..., tuple[int, str, str]]

KUKA = load_robot()
OUTCOME = BaseOutcome(0, "periodic", 100.0, 0.1, 0.2, (5.0, 5.0), True, {"joint_2": (1.08, 0.05, 1.0)}, {}, 1.0)


def test_recordings_hold_the_links_torque_in_scales_with_friction_and_offset() -> None:
    cases = (like_real(KUKA, seed) for seed in range(40))
    case = next(case for case in cases if case.scale.std() > 0 and case.rate >= 500.0)
    assert case.scale[0] == 1.0
    t, q = case.test.t, case.test.q
    assert case.kind in KINDS
    assert np.allclose(np.diff(t), 1.0 / case.rate)
    # what is left of the scaled links' torque is a function of the sign of the velocity, its size, and a constant
    smooth = filtfilt(*butter(4, 8.0, fs=case.rate), q, axis=0)
    dq = np.gradient(smooth, 1.0 / case.rate, axis=0)
    ddq = np.gradient(dq, 1.0 / case.rate, axis=0)
    model = KUKA.rigid.model
    links = np.array([pinocchio.rnea(model, model.createData(), *s) for s in zip(smooth, dq, ddq, strict=True)])
    inside = slice(500, -500)
    for joint in range(KUKA.n):
        own = np.column_stack([links[:, joint], dq[:, joint], np.sign(dq[:, joint]), np.ones(len(t))])[inside]
        found, *_ = np.linalg.lstsq(own, case.exact[inside, joint], rcond=None)
        assert found[0] == pytest.approx(case.scale[joint], rel=0.1)


def test_the_same_seed_gives_the_same_recording() -> None:
    one, again, other = like_real(KUKA, 3), like_real(KUKA, 3), like_real(KUKA, 4)
    assert np.array_equal(one.train.tau, again.train.tau)
    assert one.kind != other.kind


def test_a_summary_counts_what_it_says() -> None:
    worse = replace(OUTCOME, seed=3, error=0.3, scales={"joint_2": (1.3, 0.05, 1.0)})
    refused = replace(OUTCOME, seed=6, error=None, scales={}, refused="no")
    null = replace(OUTCOME, seed=1, kind="cyclic", scaled=False, scales={})
    invented = replace(null, seed=4, scales={"joint_3": (1.1, 0.01, 1.0)})
    data = base_summary([OUTCOME, worse, refused, null, invented])
    periodic, cyclic = data["kinds"]
    assert (periodic["cases"], periodic["as_good"], periodic["exceptions"]) == (3, 1, [3, 6])
    assert periodic["worst"] is None, "a case without a model has no ratio"
    assert (cyclic["as_good"], cyclic["worst"]) == (2, 0.5)
    counts = {rate["name"]: (rate["successes"], rate["cases"]) for rate in data["rates"]}
    assert counts == {
        "scales found where there are some": (2, 3),
        "scales invented where there are none": (1, 2),
        "scales within two sigma": (1, 2),
    }
    assert [rate["exceptions"] for rate in data["rates"]] == [[6], [4], [3]]
    assert data["refused"] == {"6": "no"}


@pytest.mark.long
def test_a_stopped_trial_goes_on(verb: Verb, tmp_path: Path) -> None:
    cases = tmp_path / "cases.jsonl"
    words = ["trial", "--family", "real", "--workers", "1", "--cases-file", str(cases), "--json"]
    code, out, _ = verb(*words, "--seeds", "3017:3018")
    assert code == 0
    first = json.loads(out)["cases"]
    code, out, _ = verb(*words, "--seeds", "3017:3019")
    assert code == 0
    data = json.loads(out)
    assert data["cases"][:1] == first
    assert [case["seed"] for case in data["cases"]] == [3017, 3018]
    assert all(0.0 < case["error"] < 0.1 for case in data["cases"]), "of the torque's spread"


@pytest.mark.parametrize("words", [("--noise", "2"), ("--folder", "x"), ("--periods", "8"), ("--kind", "null")])
def test_what_means_nothing_is_refused(verb: Verb, words: tuple[str, ...]) -> None:
    code, _, err = verb("trial", "--family", "real", *words)
    assert code == 2
    assert words[0] in err

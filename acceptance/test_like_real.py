"""Simulated recordings with the faults of real ones: the base model chosen beside a grid of fixed filters."""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from arms import write_arm
from like_real import LikeReal, like_real

from robot_ident.estimation.identify import identify
from robot_ident.estimation.predict import predict
from robot_ident.model.model import Model
from robot_ident.recording import Processing
from robot_ident.robot import Robot, load_robot

CASES = int(os.environ.get("ROBOT_IDENT_LIKE_REAL", "60"))
FIRST = 4000
"""No development has used seeds from here on."""
FILTERS = [(low, wide) for low in (2.0, 5.0, 10.0) for wide in (1.0, 4.0)]


@dataclass(frozen=True)
class Outcome:
    """One case: our error over the best of the grid, and how many sigma the scales that were found are off."""

    case: LikeReal
    ratio: float
    off: tuple[float, ...]


def robots(folder: Path) -> list[Robot]:
    out = [replace(load_robot(), base="prediction")]
    for name in ("ur5", "panda"):
        path = write_arm(name, folder)
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
        del content["effects"]  # nobody has told of rotors
        path.write_text(yaml.safe_dump(content), encoding="utf-8")
        out.append(load_robot(path))
    return out


def error(model: Model, case: LikeReal) -> float:
    predicted = predict(model, case.test)
    exact = np.column_stack([np.interp(predicted.t, case.test.t, x) for x in case.exact.T])
    ends = round(0.5 / float(np.mean(np.diff(predicted.t))))
    return float(np.sqrt(np.mean(((predicted.torque - exact)[ends:-ends] / exact.std(axis=0)) ** 2)))


def outcome(robot: Robot, seed: int) -> Outcome:
    case = like_real(robot, seed)
    scaled = case.scale.std() > 0
    further = ["torque_offset@*", *(f"torque_scale@{joint}" for joint in robot.joints[1:] if scaled)]
    if robot.n > 3:
        further.append("rotor_inertia@*")
    fixed = []
    for low, times in FILTERS:
        if low * times > 0.4 * case.rate:
            continue
        filters = Processing(
            periodic=False,
            low_pass=low,
            derivative_bandwidth=times * low,
            decimate=max(1, int(case.rate / (4 * low))),
        )
        declared = replace(robot, base="declared")
        fixed.append(
            error(identify([case.train], declared, effects=further, processing=filters, as_declared=True), case)
        )
    model = identify([case.train], robot, as_declared=True)
    off = tuple(
        (value - case.scale[robot.joint_index(p.joint or "")]) / std
        for p, value, std in zip(model.parameters, model.values, model.std, strict=True)
        if p.effect == "torque_scale"
    )
    return Outcome(case, error(model, case) / min(fixed), off)


def test_the_choice_beside_fixed_filters(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arms = robots(tmp_path)
    found = [outcome(arms[k // 3 % 3], FIRST + k) for k in range(CASES)]
    ratio = np.array([one.ratio for one in found])
    scaled = [one for one in found if one.case.scale.std() > 0]
    alike = [one for one in found if one.case.scale.std() == 0]
    off = np.abs([value for one in scaled for value in one.off])
    lines = [f"error over the best of {len(FILTERS)} fixed filters, {len(found)} cases:"]
    tenths: dict[str, float] = {}
    for kind in sorted({one.case.kind for one in found}):
        own = [one.ratio for one in found if one.case.kind == kind]
        middle, tenth = np.median(own), np.quantile(own, 0.9)
        tenths[kind] = tenth
        lines.append(f"  {kind:<9} median {middle:.3f}, 90 % below {tenth:.3f}, worst {max(own):.3f}")
    told, invented = (sum(bool(one.off) for one in group) for group in (scaled, alike))
    lines.append(f"  scales found in {told} of {len(scaled)} cases that have some, in {invented} of {len(alike)}")
    lines.append(f"  that have none; {100 * np.mean(off < 2):.0f} % of them within two sigma")
    with capsys.disabled():
        print("\n" + "\n".join(lines))
    assert np.median(ratio) <= 1.0
    assert max(tenths["one pass"], tenths["periodic"]) <= 1.05
    assert tenths["cyclic"] <= 1.25, "a handful of poses, judged on a path that they don't tell of"
    assert np.mean(off < 2.0) >= 0.9
    assert np.mean([not one.off for one in alike]) >= 0.95

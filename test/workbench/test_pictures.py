"""The pictures hold the figures of `compare`, and say them in words."""

from __future__ import annotations

import base64
import json
from typing import Any

import numpy as np
import pytest

from robot_ident.report.wording import short
from robot_ident.workbench.brushing import Condition, Look
from robot_ident.workbench.pictures import (
    MOST_POINTS,
    over_time,
    over_time_told,
    scatter,
    spectrum,
    spectrum_told,
    staircase,
    staircase_told,
)
from robot_ident.workbench.view import CANDIDATE, View


@pytest.fixture(scope="module")
def view(bench: Any) -> View:
    return View(bench.session, 0)


def values(picture: dict[str, Any], name: str, axis: str = "y") -> Any:
    """Return what the browser makes of a trace."""
    found = next(one for one in picture["data"] if one["name"] == name)[axis]
    return np.frombuffer(base64.b64decode(found["bdata"]), f"<{found['dtype']}")


def test_a_residual_is_drawn_with_its_extremes(view: View) -> None:
    joint = view.worst
    picture = over_time(Look(view, joint))
    used = view.rows[0].weight[:, joint] > 0
    residual = view.residual[0][used, joint]
    drawn = values(picture, "residual")
    assert (np.nanmin(drawn), np.nanmax(drawn)) == pytest.approx((residual.min(), residual.max()), rel=1e-6)
    peak = float(np.abs(residual).max())
    assert f"at most {short(peak)}" in over_time_told(Look(view, joint))
    json.dumps(picture)  # nothing in it that a browser could not take


def test_a_candidate_and_a_region_are_laid_over(view: View) -> None:
    joint = view.worst
    label = next(iter(view.previews))
    overlays = view.overlays([f"{CANDIDATE}{label}", "with:nothing@joint_9"])
    assert [one.words for one in overlays] == [f"with {label}"]
    region = [Condition(f"velocity of {view.joints[joint]}", -0.2, 0.2)]
    look = Look(view, joint, overlays=overlays, conditions=region, shade="dark")
    picture = scatter(look)
    x = values(picture, "brushed", "x")
    assert np.all(np.abs(x) <= 0.2 + 1e-6)
    assert 0 < len(x) < len(values(picture, "residual", "x")) <= 2 * MOST_POINTS
    assert [shape["x0"] for shape in picture["layout"]["shapes"]] == [-0.2]
    assert any(one["name"].startswith(f"mean with {label}") for one in picture["data"])
    later = over_time(look)
    assert any(label in one["name"] for one in later["data"])


def test_lines_and_levels_are_those_of_the_figures_on_disk(view: View) -> None:
    joint = view.worst
    lines = spectrum(Look(view, joint))
    largest = float(view.residual_lines[0][:, joint].max())
    assert max(float(np.max(values(lines, one["name"]))) for one in lines["data"]) == pytest.approx(largest, rel=1e-6)
    assert f"{short(largest)} Nm rms" in spectrum_told(Look(view, joint))
    # Parseval: lines and mean hold the residual's mean square, but for what a low pass takes away
    square = float(np.mean(np.where(view.rows[0].weight[:, joint] > 0, view.residual[0][:, joint], 0.0) ** 2))
    assert float(np.sum(view.residual_lines[0][:, joint] ** 2)) == pytest.approx(square, rel=0.05)
    stairs = staircase(Look(view, joint))
    expected = view.errors["training"][view.joints[joint]] ** 0.5
    assert values(stairs, "training") == pytest.approx([expected], rel=1e-6)
    assert f"training {short(expected)} Nm rms" in staircase_told(Look(view, joint))

"""What a design takes for an effect's columns, against the columns that an identification uses."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from robot_ident.design.design import design
from robot_ident.design.family import family_of
from robot_ident.design.target import Target
from robot_ident.effects import CATALOGUE
from robot_ident.errors import InputError
from robot_ident.model.expressions import columns_function
from robot_ident.model.structure import Structure
from robot_ident.robot import Robot
from robot_ident.signals.motion import Array

LIKENESS = {"presliding": 0.8, "friction_behind_play": 0.85, "backlash": 0.85, "joint_elasticity": 0.85}
"""Correlation of a stand-in with the exact column along a usual motion; every other effect's is one."""

RINGS = ("backlash",)
"""Effects of whose stand-in the power within half a second is compared: how blows ring is no function of the state."""

HIDDEN = ("temperature_drift", *(name for name, effect in CATALOGUE.items() if effect.measuring))
"""What no periodic motion shows, and faults of measuring, which are no part of a model."""


def label(name: str) -> str:
    return name if CATALOGUE[name].scope == "robot" else f"{name}@joint_2"


def designed_and_exact(kuka: Robot, name: str) -> tuple[Array, Array]:
    """Return the columns of an effect [N n, k] as designs and as identifications take them, on a random motion."""
    structure = Structure.build(kuka, [label(name)])
    base = Structure.build(kuka)
    values = np.zeros(len(structure.parameters))
    values[: len(base.parameters)] = base.true_values()
    family, points = family_of(0.1, 150.0), 3000
    table = 0.25 * np.random.default_rng(0).normal(size=(11, 3))
    phi = columns_function(structure, values=values)
    bases = family.bases(np.arange(points) / points * 10.0, phi.n_in() - 1)
    flat = np.array(phi.map(points)(*((basis @ table).T for basis in bases)))
    smooth = flat.reshape(3, points, -1).transpose(1, 0, 2)
    exact = structure.columns(family.motion(table, points), values)
    place = len(base.parameters)
    return smooth[:, :, place:].reshape(3 * points, -1), exact[:, :, place:].reshape(3 * points, -1)


def power(column: Array) -> Array:
    """Return the rms [N] over joints and half a second of a column [N n] at 300 Hz."""
    from scipy.ndimage import uniform_filter1d

    squares = np.sum(column.reshape(-1, 3) ** 2, axis=1)
    return np.sqrt(np.maximum(uniform_filter1d(squares, 150, mode="wrap"), 0.0))


@pytest.mark.parametrize("name", [n for n in CATALOGUE if n not in (*HIDDEN, "viscous", "coulomb")])
def test_every_effect_of_the_catalogue_can_be_designed_for(kuka: Robot, name: str) -> None:
    at = kuka
    try:
        Structure.build(at, [label(name)])
    except InputError as error:
        assert "merges" in str(error) or "no gear_ratio" in str(error)  # not an effect of this joint
        return
    smooth, exact = designed_and_exact(at, name)
    for mine, true in zip(smooth.T, exact.T, strict=True):
        if name in RINGS:
            mine, true = power(mine), power(true)
        size = np.linalg.norm(true)
        assert size > 0.0
        assert mine @ true / (size * np.linalg.norm(mine)) > LIKENESS.get(name, 0.9999)
        assert np.linalg.norm(mine) == pytest.approx(size, rel=0.15 if name in LIKENESS else 0.01)


@pytest.mark.parametrize(
    ("labels", "words"),
    [
        (
            ["temperature_drift@joint_1"],
            "no excitation can be designed for temperature_drift@joint_1: a periodic motion",
        ),
        (["payload"], "invisible in one run"),
    ],
)
def test_what_no_motion_shows_is_one_line(kuka: Robot, labels: list[str], words: str) -> None:
    with pytest.raises(InputError, match=words):
        design(kuka, effects=labels, workers=1)


def test_a_design_for_effects_with_memory_and_of_the_load(kuka: Robot) -> None:
    seen: list[Any] = []
    found = design(
        kuka,
        effects=["presliding@joint_2", "joint_elasticity@joint_3"],
        harmonics=3,
        starts=1,
        workers=1,
        progress=seen.append,
        cancel=lambda: len(seen) > 0,
    )
    assert found.parameters[-2:] == ("presliding.level@joint_2", "joint_elasticity.compliance@joint_3")
    assert np.all(np.isfinite(found.sigma))
    assert found.notes[0].startswith("the columns of joint_elasticity@joint_3 depend on the torque: taken from")
    target = Target.of_robot(kuka, ["presliding@joint_2", "joint_elasticity@joint_3"])
    assert target.judge(found.excitations).log10_det_covariance == found.log10_det_covariance

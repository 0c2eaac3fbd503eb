"""Motions of special families: symmetric, within a bandwidth, several together, beside what is known already."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from robot_ident.design.criteria import evaluate
from robot_ident.design.design import DesignResult, Progress, design
from robot_ident.design.family import family_of
from robot_ident.design.target import Target
from robot_ident.errors import InputError
from robot_ident.limits.certifier import certify
from robot_ident.model.structure import Structure
from robot_ident.residuals.curves import mirror
from robot_ident.robot import Robot

SHORT: dict[str, Any] = {"base_frequency": 0.25, "sample_rate": 50.0, "harmonics": 3, "starts": 1, "workers": 1}
"""Short periods and few harmonics: quick to design."""


def test_a_symmetric_motion_has_a_mirror(gantry: Robot) -> None:
    found = design(gantry, symmetric=True, **SHORT)
    assert found.margins.kept
    assert not np.any(found.excitation.series.a)
    assert mirror(found.excitation.samples().q) is not None
    assert found.excitation.reproduce["symmetric"] is True
    assert np.isfinite(found.log10_det_covariance)


def test_harmonics_keep_to_the_bandwidth(gantry: Robot) -> None:
    found = design(gantry, bandwidth=(0.7, 1.6), **SHORT)
    series = found.excitation.series
    moving = np.any(series.a != 0.0, axis=0) | np.any(series.b != 0.0, axis=0)
    np.testing.assert_array_equal(np.flatnonzero(moving) + 1, [3, 4, 6])
    assert found.margins.kept
    assert found.excitation.reproduce["bandwidth"] == [0.7, 1.6]
    assert np.isfinite(found.log10_det_covariance)


@pytest.mark.parametrize(
    ("bandwidth", "harmonics", "orders"),
    [
        (None, None, (1, 2, 3, 4, 5)),
        ((0.0, 0.3), None, (1, 2, 3)),
        ((2.5, 10.0), 4, (25, 50, 75, 100)),
        ((0.3, 0.5), 5, (3, 4, 5)),
    ],
)
def test_which_harmonics_a_bandwidth_holds(bandwidth: Any, harmonics: int | None, orders: tuple[int, ...]) -> None:
    assert family_of(0.1, 150.0, harmonics, bandwidth).orders == orders


@pytest.mark.parametrize(
    ("bandwidth", "words"),
    [
        ((0.11, 0.19), r"holds no harmonic of 0.1 Hz \(the nearest are at 0.1 and 0.2 Hz\)"),
        ((0.5, 0.4), "LO:HI with 0 <= LO < HI"),
        ((-1.0, 0.4), "LO:HI with 0 <= LO < HI"),
        ((2.5, 100.0), "reaches harmonic 1000 of 0.1 Hz; at most 400"),
        ((2.5, 30.0), "300 harmonics of 0.1 Hz need a sample rate above 60 Hz, not 50 Hz"),
    ],
)
def test_a_bandwidth_that_cannot_be(bandwidth: tuple[float, float], words: str) -> None:
    with pytest.raises(InputError, match=words):
        family_of(0.1, 50.0, None, bandwidth)


def test_derivatives_of_a_family_are_those_of_its_series() -> None:
    family = family_of(0.1, 150.0, 3, (0.2, 0.6))
    rng, t = np.random.default_rng(0), np.linspace(0.0, 10.0, 9)
    table = rng.normal(size=(1 + 2 * family.harmonics, 2))
    motion, bases = family.series(table).motion(t), family.bases(t, 4)
    for basis, expected in zip(bases, (motion.q, motion.dq, motion.ddq), strict=False):
        np.testing.assert_allclose(basis @ table, expected, atol=1e-12)
    h = 1e-5
    later, before = family.bases(t + h, 3), family.bases(t - h, 3)
    for order in (3, 4):
        slope = (later[order - 1] - before[order - 1]) @ table / (2 * h)
        np.testing.assert_allclose(bases[order] @ table, slope, rtol=1e-6, atol=1e-6)


@pytest.fixture(scope="module")
def two(gantry: Robot) -> DesignResult:
    return design(gantry, trajectories=2, seed=3, **SHORT)


@pytest.mark.long
def test_two_together_tell_more_than_one_twice(gantry: Robot, two: DesignResult) -> None:
    assert len(two.excitations) == len(two.margins_of_each) == 2
    assert all(certify(one, gantry).kept for one in two.excitations)
    structure = Structure.build(gantry)
    alone = [evaluate(structure, one).log10_det_covariance for one in two.excitations]
    twice = min(alone) - len(structure.names) * np.log10(2.0)
    assert two.log10_det_covariance < twice
    assert two.log10_det_covariance == Target.of_robot(gantry).judge(two.excitations).log10_det_covariance
    assert [one.achieved["motion"] for one in two.excitations] == [1, 2]


def test_turns_never_make_a_set_worse(two: DesignResult) -> None:
    costs = [cost for _, cost in two.history]
    assert costs == sorted(costs, reverse=True)
    assert costs[-1] == pytest.approx(two.log10_det_covariance, abs=1e-6)


def test_the_condition_number_of_several(gantry: Robot) -> None:
    seen: list[Progress] = []
    stop = {"progress": seen.append, "cancel": lambda: len(seen) > 6}
    found = design(gantry, criterion="condition", determinant_floor=0.0, trajectories=2, **stop, **SHORT)
    assert found.condition_number == Target.of_robot(gantry).judge(found.excitations).condition_number
    assert found.margins.kept


def test_cancelling_several_leaves_certified_ones(gantry: Robot) -> None:
    seen: list[Progress] = []
    found = design(gantry, trajectories=3, progress=seen.append, cancel=lambda: len(seen) > 2, **SHORT)
    assert found.interrupted
    assert len(found.excitations) == 3
    assert found.margins.kept
    assert seen[0].phase.startswith("motion 1 of 3")


def test_a_prior_moves_the_design_to_what_is_unknown(gantry: Robot) -> None:
    target = Target.of_robot(gantry)
    plain = design(gantry, **SHORT)
    names = target.structure.names
    friction = [k for k, name in enumerate(names) if name.startswith(("viscous", "coulomb"))]
    rest = [k for k in range(len(names)) if k not in friction]
    known = np.zeros((len(names),) * 2)
    known[friction, friction] = 1e9
    beside = design(gantry, prior=known, **SHORT)

    def unknown(result: DesignResult) -> float:
        rows = target.rows(result.excitation)
        return float(np.linalg.slogdet((rows.T @ rows)[np.ix_(rest, rest)])[1])

    assert unknown(beside) > unknown(plain)
    assert np.all(beside.sigma[friction] < 1e-4)
    assert beside.excitation.achieved["with_prior"]
    assert beside.log10_det_covariance == target.judge(beside.excitations, prior=known).log10_det_covariance
    with pytest.raises(InputError, match="prior: information about the"):
        design(gantry, prior=np.eye(2), **SHORT)

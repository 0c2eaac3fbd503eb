"""The bound of the determinant: closed forms, trajectories that must not pass it, and what tightens it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from robot_ident.design.bound import Bound, determinant_bound
from robot_ident.design.bound.moments import Moments, StateSet
from robot_ident.design.bound.oracle import Oracle, seed_motions
from robot_ident.design.bound.relaxation import Pool, Proof, Relaxation
from robot_ident.design.family import Family, family_of
from robot_ident.design.target import Target
from robot_ident.errors import InputError
from robot_ident.robot import Robot, load_robot
from robot_ident.signals.motion import Motion
from robot_ident.trajectories.excitation import Excitation
from robot_ident.trajectories.fourier_series import FourierSeries

SLIDER = """<robot name="slider"><link name="base"/>
<joint name="slide" type="prismatic"><parent link="base"/><child link="carriage"/><axis xyz="1 0 0"/>
<limit lower="-{half}" upper="{half}" velocity="0.5" effort="100"/></joint>
<link name="carriage"><inertial><mass value="5"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>
</link></robot>"""


def slider(folder: Path, half: float, acceleration: float = 9.0) -> Robot:
    (folder / "slider.urdf").write_text(SLIDER.format(half=half), encoding="utf-8")
    text = "schema: robot_ident/robot/1\nname: slider\nurdf: slider.urdf\nend_effector: carriage\njoints:\n"
    text += f"  slide: {{acceleration: {acceleration}, torque_variance: 1.6}}\n"
    (folder / "slider.yaml").write_text(text, encoding="utf-8")
    return load_robot(folder / "slider.yaml")


def best(
    robot: Robot, family: Family, columns: Callable[[ca.SX, ca.SX, ca.SX], list[ca.SX]], tolerance: float
) -> Proof:
    """Return the proof for the largest determinant with such columns, of noise of variance 1."""
    states = StateSet.of(robot, 2 * np.pi * family.base_frequency, 2 * np.pi * family.base_frequency * family.harmonics)
    moments = Moments.of(states, 2 * np.pi * family.base_frequency, states.top_frequency, 3)
    q, dq, ddq = (ca.SX.sym(name, 1) for name in ("q", "dq", "ddq"))
    phi = ca.Function("phi", [q, dq, ddq], [ca.horzcat(*columns(q, dq, ddq))])
    p, rng = phi.size2_out(0), np.random.default_rng(0)
    oracle = Oracle(robot, phi, moments, np.ones(p), np.ones(1))
    pool = Pool(*oracle.rows(*states.coordinates(seed_motions(robot, states, rng, family))))
    pool.add(*oracle.rows(*oracle.random_starts(rng, 200)))
    return Relaxation(oracle, pool, np.zeros((p, p)), np.inf).bound(moments, tolerance)


@pytest.mark.long
def test_a_mass_on_a_slide_in_closed_form(tmp_path: Path) -> None:
    """With room enough, E[ddq^2] of harmonics up to L is at most (L w V)^2 / 2: a sinusoid of amplitude V at L."""
    family = family_of(0.5, 100.0, 3)
    proof = best(slider(tmp_path, half=1.0), family, lambda q, dq, ddq: [ddq], 1e-3)
    assert np.exp(proof.upper) == pytest.approx((2 * np.pi * 1.5 * 0.5) ** 2 / 2, rel=3e-3)
    assert 0.0 <= proof.upper - proof.lower < 2e-3


@pytest.mark.long
def test_wirtinger_bounds_how_far_a_motion_spreads(tmp_path: Path) -> None:
    """det E[(1, q)' (1, q)] = Var q. States at rest at both ends of the slide would spread by 4 m^2, but no motion."""
    family, robot = family_of(0.05, 10.0, 4), slider(tmp_path, half=2.0)
    proof = best(robot, family, lambda q, dq, ddq: [ca.SX(1), q], 0.05)
    w, top = 2 * np.pi * 0.05, 0.5
    assert (top / w) ** 2 / 2 < np.exp(proof.upper) < 1.06 * (top / w) ** 2, "a sinusoid below, E[dq^2] <= V^2 above"


@pytest.fixture(scope="module")
def kuka_family() -> Family:
    return family_of(0.1, 150.0)


@pytest.fixture(scope="module")
def kuka_bound(kuka: Robot, kuka_family: Family) -> Bound:
    return determinant_bound(Target.of_robot(kuka), kuka_family, degree=2, time_limit=4.0)


def test_no_random_trajectory_passes_it(
    kuka: Robot, kuka_bound: Bound, random_excitation: Callable[..., Excitation]
) -> None:
    target = Target.of_robot(kuka)
    for seed in range(30):
        achieved = target.judge([random_excitation(seed)]).log10_det_covariance
        assert kuka_bound.log10_det_covariance < achieved
        assert 0.0 < kuka_bound.efficiency(achieved) < 1.0
    assert kuka_bound.log10_det_covariance <= kuka_bound.relaxed


def test_the_paper_and_what_was_reached_since_lie_above_it(kuka_bound: Bound) -> None:
    assert kuka_bound.log10_det_covariance < -51.6
    assert kuka_bound.efficiency(np.log10(2.36e-49)) < kuka_bound.efficiency(-51.6) < 1.0


def test_states_hold_every_certified_trajectory(kuka: Robot, random_excitation: Callable[..., Excitation]) -> None:
    """What the states leave out of the limits, no band-limited motion reaches."""
    w = 2 * np.pi * 0.1
    states = StateSet.of(kuka, w, 5 * w)
    inside = 0
    symbols = ca.SX.sym("c", 9), ca.SX.sym("s", 3)
    state = ca.Function("state", [*symbols], states.expressions(*symbols))
    for seed in range(60):
        excitation = random_excitation(seed, share=0.999)
        q, dq, ddq = excitation.series.extremes()
        limits = kuka.limits
        if not np.all([q.lower > limits.lower, q.upper < limits.upper]):
            continue
        assert np.all(dq.largest < limits.velocity) and np.all(ddq.largest < limits.acceleration)
        inside += 1
        motion = excitation.series.motion(np.linspace(0.0, 10.0, 2000))
        c, sign = states.coordinates(motion)
        for part, again in zip((motion.q, motion.dq, motion.ddq), state(c.T, sign.T), strict=True):
            assert np.abs(part - np.array(again).T).max() < 1e-6
    assert inside > 40


def test_moments_hold_for_every_trajectory(gantry: Robot) -> None:
    """Stationarity to rounding and the inequalities, from samples as coarse as they may be."""
    f0, harmonics = 0.25, 4
    w = 2 * np.pi * f0
    states = StateSet.of(gantry, 2 * w, harmonics * w)
    moments = Moments.of(states, 2 * w, harmonics * w, 3).with_direction(np.array([0.3, -0.7]))
    rng = np.random.default_rng(3)
    for _ in range(50):
        a, b = rng.normal(size=(2, 2, harmonics)) * 0.2
        a[:, 0] = b[:, 0] = 0.0
        motion = FourierSeries(f0, rng.normal(size=2), a, b).motion(np.arange(13) / 13 / f0)
        size = np.abs(moments.equalities(motion)).max()
        assert np.abs(moments.equalities(motion).mean(axis=0)).max() < 1e-12 * max(1.0, size)
        mean = motion.q.mean(axis=0)
        cell = replace(moments, lo=mean - 0.1, hi=mean + 0.2)
        assert cell.inequalities(motion).mean(axis=0).max() < 1e-12


def test_multipliers_price_states_as_rows_do(gantry: Robot) -> None:
    w = 2 * np.pi * 0.25
    states = StateSet.of(gantry, w, 4 * w)
    moments = Moments.of(states, w, 4 * w, 3).split(1, 0.3)[0].with_direction(np.array([0.3, -0.7]))
    rng = np.random.default_rng(0)
    motion = Motion(*rng.normal(size=(3, 20, 2)))
    rows, more = moments.equalities(motion), moments.inequalities(motion)
    equal, unequal = rng.normal(size=rows.shape[1]), rng.random(more.shape[1])
    state = [ca.SX.sym(name, 2) for name in ("q", "dq", "ddq")]
    prices = [ca.SX.sym("equal", len(equal)), ca.SX.sym("quadratic", 2, 5)]
    cost = ca.Function("cost", [*state, *prices], [moments.expression(*prices, tuple(state))])
    found = np.array(cost(motion.q.T, motion.dq.T, motion.ddq.T, equal, moments.compact(unequal))).ravel()
    assert found == pytest.approx(rows @ equal + more @ unequal, abs=1e-9)


@pytest.fixture(scope="module")
def short_slide(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    return slider(tmp_path_factory.mktemp("short"), half=0.4, acceleration=2.0)


@pytest.fixture(scope="module")
def wide(short_slide: Robot) -> Bound:
    """Return the bound of one motion of five harmonics on the short slide."""
    return determinant_bound(Target.of_robot(short_slide), family_of(0.25, 100.0, 5))


@pytest.mark.long
def test_what_restricts_the_motion_tightens_the_bound(short_slide: Robot, wide: Bound) -> None:
    robot, target = short_slide, Target.of_robot(short_slide)
    fewer = determinant_bound(target, family_of(0.25, 100.0, 2))
    limits = replace(robot.limits, velocity=robot.limits.velocity * 0.6)
    slow = replace(robot, limits=limits)
    slower = determinant_bound(Target.of_robot(slow), family_of(0.25, 100.0, 5))
    assert wide.log10_det_covariance < fewer.log10_det_covariance - 0.05
    assert wide.log10_det_covariance < slower.log10_det_covariance - 0.05
    for bound in (wide, fewer, slower):
        assert bound.relaxed - bound.log10_det_covariance < 3 * np.log10(1.03) + 1e-9, "the dual gap closes"


@pytest.mark.long
def test_more_motions_and_what_is_known_already(short_slide: Robot, wide: Bound) -> None:
    target = Target.of_robot(short_slide)
    family, p = family_of(0.25, 100.0, 5), len(target.structure.names)
    one, four = wide, determinant_bound(target, family, trajectories=4)
    slack = 2 * p * np.log10(1.03)
    assert four.log10_det_covariance == pytest.approx(one.log10_det_covariance - p * np.log10(4.0), abs=slack)
    series = FourierSeries(0.25, np.zeros(1), np.array([[0.1, 0.05, 0.1]]), np.array([[0.0, 0.1, 0.02]]))
    excitation = Excitation("slider", ("slide",), series, 100.0)
    information = target.rows(excitation).T @ target.rows(excitation)
    more = determinant_bound(target, family, prior=1e3 * information)
    _, known = np.linalg.slogdet(1e3 * information)
    assert more.log10_det_covariance < one.log10_det_covariance
    assert more.log10_det_covariance < -known / np.log(10.0) < more.log10_det_covariance + 1.0


def test_columns_that_are_no_function_of_the_state(kuka: Robot) -> None:
    target = Target.of_robot(kuka, ["backlash@joint_2"])
    with pytest.raises(InputError, match="backlash@joint_2"):
        determinant_bound(target, family_of(0.1, 150.0))

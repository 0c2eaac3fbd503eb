from __future__ import annotations

import numpy as np
import pytest

from robot_ident.testbed.dry_friction import friction_law


def law(v: float, force: float, *, m: float = 2.0, c: float = 3.0, h: float = 0.1, phi: float = 1.0, jump: float = 0.0):
    return tuple(float(x) for x in friction_law()(v, force, m, c, h, phi, jump))


def by_tiny_steps(
    v: float, force: float, phi: float, jump: float, m: float = 2.0, c: float = 3.0, h: float = 0.1
) -> float:
    """Return the velocity after the step from 20000 implicit steps of the same inclusion."""
    parts = 20000
    for k in range(parts):
        f = force + (1 - phi) * jump if k < phi * parts else force - phi * jump
        free = v + h / parts * f / m
        v = np.sign(free) * max(abs(free) - h / parts * c / m, 0.0)
    return v


@pytest.mark.parametrize("v", [-0.4, -0.05, 0.0, 0.03, 0.5])
@pytest.mark.parametrize("force", [-9.0, -3.5, -1.0, 2.0, 4.0])
@pytest.mark.parametrize(("phi", "jump"), [(1.0, 0.0), (0.3, 6.0), (0.7, -6.0)])
def test_the_step_is_the_exact_solution(v: float, force: float, phi: float, jump: float) -> None:
    w, after, _ = law(v, force, phi=phi, jump=jump)
    assert after == pytest.approx(by_tiny_steps(v, force, phi, jump), abs=2e-4)
    assert w == pytest.approx((after - v) / 0.1, abs=1e-12)


def test_slope_is_the_derivative_and_monotone() -> None:
    rng = np.random.default_rng(0)
    for _ in range(300):
        v, force, phi, jump = rng.normal(0, 0.2), rng.normal(0, 5), rng.random(), rng.choice([0.0, 6.0, -6.0])
        w, _, slope = law(v, force, phi=phi, jump=jump)
        more, _, slope_more = law(v, force + 1e-6, phi=phi, jump=jump)
        assert -1e-12 <= slope <= 0.5 + 1e-12
        if abs(slope - slope_more) < 1e-4:  # not over a kink
            assert (more - w) / 1e-6 == pytest.approx(slope, abs=1e-3)


def test_stick_is_exactly_zero() -> None:
    assert law(0.0, 2.999)[:2] == (0.0, 0.0)
    assert law(0.0, -2.999)[:2] == (0.0, 0.0)
    assert law(0.01, 1.0)[1] == 0.0, "what stops within the step stays"
    assert law(0.0, 3.001)[1] > 0


def test_a_reversal_that_compensation_meets_is_exact() -> None:
    """With friction compensated by a jump at the instant of reversal the acceleration is as if there were none."""
    v, a, h = 0.05, -1.2, 0.1
    phi = v / (-a * h)
    mean = 2.0 * a + 3.0 * (phi - (1 - phi))
    assert law(v, mean, phi=phi, jump=6.0)[1] == pytest.approx(v + h * a, abs=1e-14)

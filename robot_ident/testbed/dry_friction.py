"""Dry friction over one time step, stick and slip: of one joint the exact solution of a differential inclusion, of all
at once a coupled set-valued problem, solved in a fixed number of operations.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import casadi as ca


def _phase(v: Any, force: Any, mass: Any, level: Any, h: Any) -> tuple[Any, Any, Any]:
    """Return the velocity after a time h under a constant force, the slipping acceleration, and whether it slips on.

    m dv/dt in F - c Sgn(v): the joint slips until its velocity is zero; from there it sticks exactly where |F| <= c and
    leaves in the force's direction otherwise.
    """
    slip = (force - level * ca.sign(v)) / mass
    v_slip = v + h * slip
    keeps = v_slip * v > 0
    # The guard keeps the branch that isn't taken finite: its derivative is multiplied by zero, not left out.
    stop = v / ca.if_else(ca.logic_or(keeps, v == 0), 1.0, v - v_slip)
    excess = force - ca.fmin(ca.fmax(force, -level), level)
    v_after = (1 - stop) * h * excess / mass
    return ca.if_else(keeps, v_slip, v_after), slip, keeps


@cache
def friction_law() -> Any:
    """Return the CasADi function (v, F, m, c, h, phi, J) -> (w, v1, dw/dF) of one joint over a step of length h.

    v [rad/s] velocity before, F [Nm] mean force on the joint without its dry friction, m [kg m^2] its inertia, c [Nm]
    level of dry friction. The force may jump once: it is F + (1 - phi) J before the fraction phi of the step and F -
    phi J after it, so that a drive which compensates friction by the sign of its reference isn't smeared over the step.
    v1 is the velocity after, exactly zero where the joint sticks, and w = (v1 - v) / h. w is continuous and not
    decreasing in F, with slope in [0, 1 / m] (a maximal monotone law, Moreau 1988), which makes the coupled problem
    uniquely solvable.
    """
    v, force, mass, level, h, phi, jump = (ca.SX.sym(name) for name in ("v", "F", "m", "c", "h", "phi", "J"))
    v_half, slip_1, keeps_1 = _phase(v, force + (1 - phi) * jump, mass, level, phi * h)
    v_end, slip_2, keeps_2 = _phase(v_half, force - phi * jump, mass, level, (1 - phi) * h)
    # The mean of the accelerations has no rounding error of order eps v / h, which matters in the limit h -> 0.
    w = ca.if_else(ca.logic_and(keeps_1, keeps_2), phi * slip_1 + (1 - phi) * slip_2, (v_end - v) / h)
    inputs = [v, force, mass, level, h, phi, jump]
    return ca.Function("friction_law", inputs, [w, v_end, ca.jacobian(w, force)])


NEWTON_STEPS = 5
"""Newton steps in every time step: the prediction alone is exact in most, one more is needed for each joint that
stops, turns or breaks away in the same step."""

SWEEPS = 2
"""Gauss-Seidel sweeps after them, the last of which says which joints stick."""

FLATTEST = 1e-9
"""Smallest slope of friction over force that a Newton step divides by; a joint that slips has slope zero."""


@dataclass(frozen=True)
class StepProblem:
    """A w + lambda = F: mean acceleration w [n], mean dry friction lambda [n] of a step, lambda_i set-valued in v_i.

    inertia A [n, n] with what is taken implicitly, force F [n] without dry friction, velocity [n] before the step,
    level [n] of dry friction, h the step [s], fraction and jump [n]: where in the step the force jumps, and by how
    much.
    """

    inertia: Any
    force: Any
    velocity: Any
    level: Any
    h: Any
    fraction: Any
    jump: Any


class _Dual:
    """The problem in terms of lambda, with G = inv(A).

    Joint i feels the mass m_i = 1 / G_ii and, without its own friction, the force m_i (w_free - G lambda)_i + lambda_i.
    In this form a joint that slips has constant lambda and doesn't disturb the others: the difficulty lies with joints
    that stick, and those a Newton step solves together. Coordinates without dry friction take no part: G, free and
    problem are those of the n that have it, everything of all is in `all_g` and `all_free`.
    """

    def __init__(self, problem: StepProblem) -> None:
        size = problem.force.shape[0]
        d, lt, p = ca.ldl(problem.inertia)
        self.all_g = ca.ldl_solve(ca.SX.eye(size), d, lt, p)
        self.all_free = ca.mtimes(self.all_g, problem.force)
        self.dry = [i for i in range(size) if not problem.level[i].is_zero()]
        self.n = len(self.dry)
        self.g, self.free = self.all_g[self.dry, self.dry], self.all_free[self.dry]
        self.mass = [1 / self.g[i, i] for i in range(self.n)]
        pick = {key: getattr(problem, key)[self.dry] for key in ("velocity", "level", "fraction", "jump")}
        self.problem = replace(problem, **pick)

    def joint(self, i: int, friction: Any) -> tuple[Any, Any, Any]:
        """Return friction, velocity after and d(friction)/d(force) of joint i when the others have `friction`."""
        p, m = self.problem, self.mass[i]
        others = sum((self.g[i, j] * friction[j] for j in range(self.n) if j != i), start=ca.SX(0))
        force = m * (self.free[i] - others)
        w, after, slope = friction_law()(p.velocity[i], force, m, p.level[i], p.h, p.fraction[i], p.jump[i])
        return force - m * w, after, 1 - m * slope

    def sweep(self, friction: Any) -> tuple[Any, Any]:
        """Return friction after one Gauss-Seidel sweep over the joints, and their velocities."""
        friction, after = ca.SX(friction), ca.SX(self.n, 1)
        for i in range(self.n):
            friction[i], after[i], _ = self.joint(i, friction)
        return friction, after

    def predict(self) -> Any:
        """Return the friction [n] with which joints that slip slip on and joints at rest stay, whatever their level."""
        p = self.problem
        rests = p.velocity == 0
        slip = ca.if_else(rests, 0, p.level * ca.sign(p.velocity))
        right = ca.if_else(rests, self.free - ca.mtimes(self.g, slip), slip)
        matrix = ca.SX(self.n, self.n)
        for i in range(self.n):
            for j in range(self.n):
                matrix[i, j] = ca.if_else(ca.logic_and(rests[i], rests[j]), self.g[i, j], float(i == j))
        d, lt, order = ca.ldl(matrix)
        return ca.ldl_solve(right, d, lt, order)

    def newton(self, friction: Any) -> Any:
        """Return friction after one semismooth Newton step.

        Between steps friction may lie outside of its level: a joint then is seen to break away (a primal-dual active
        set method, Hintermueller, Ito and Kunisch 2002). Rows divided by E_i m_i, with slope E_i in [0, 1], give (G +
        diag(1 / (E m) - G_ii)) d = -r / (E m): symmetric and positive definite.
        """
        matrix, right = ca.SX(self.g), ca.SX(self.n, 1)
        for i in range(self.n):
            target, _, slope = self.joint(i, friction)
            steepness = 1 / (self.mass[i] * ca.fmax(slope, FLATTEST))
            matrix[i, i] = steepness
            right[i] = (target - friction[i]) * steepness
        d, lt, p = ca.ldl(matrix)
        return friction + ca.ldl_solve(right, d, lt, p)


def solve(problem: StepProblem) -> tuple[Any, Any, Any]:
    """Return lambda, w and the velocity after the step, all [n]: the velocity exactly zero where a joint sticks."""
    dual, size = _Dual(problem), problem.force.shape[0]
    if not dual.n:
        return ca.SX.zeros(size), dual.all_free, problem.velocity + problem.h * dual.all_free
    friction = dual.predict()
    for _ in range(NEWTON_STEPS):
        friction = dual.newton(friction)
    for _ in range(SWEEPS):
        friction, after = dual.sweep(friction)
    w = dual.all_free - ca.mtimes(dual.all_g[:, dual.dry], friction)
    everywhere, v = ca.SX.zeros(size), problem.velocity + problem.h * w
    everywhere[dual.dry] = friction
    v[dual.dry] = ca.if_else(after == 0, 0, v[dual.dry])
    return everywhere, w, v

"""Dry friction of one joint over one time step, stick and slip: the exact solution of a differential inclusion."""

from __future__ import annotations

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

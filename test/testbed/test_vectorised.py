"""CasADi functions on many instants at once: every operation against CasADi itself."""

from __future__ import annotations

import pickle

import casadi as ca
import numpy as np
import pytest

from robot_ident.testbed.vectorised import AT_ONCE, FEW, Vectorised

X, Y = ca.SX.sym("x"), ca.SX.sym("y")
EXPRESSIONS = {
    "arithmetic": (X + Y) * X / (Y + 5) - 2 * X + X**2 - 3,
    "powers": (X**2 + 1) ** Y + (X**2) ** 0.7 + ca.sqrt(Y**2 + 1) + 1 / (X**2 + 1),
    "exponentials": ca.exp(X) + ca.log(Y**2 + 1) + ca.sinh(X) + ca.cosh(Y) + ca.tanh(X) + ca.asinh(X),
    "angles": ca.sin(X) + ca.cos(Y) + ca.tan(X) + ca.atan(Y) + ca.atan2(X, Y) + ca.asin(X / 2) + ca.acos(Y / 2),
    "choice": ca.if_else(X > Y, 1 / (X - Y), Y) + ca.fmin(X, Y) * ca.fmax(X, 0.1),
    "logic": ca.logic_and(X > 0, Y <= 0) + 2 * ca.logic_or(X >= Y, Y < 0) + 4 * ca.logic_not(X > 0) + 8 * (X != 0),
    "steps": ca.sign(X) + ca.fabs(Y) + ca.floor(X) + ca.ceil(Y) + ca.copysign(X, Y),
}


@pytest.mark.parametrize("name", EXPRESSIONS)
def test_operations(name: str) -> None:
    function = ca.Function("f", [ca.vertcat(X, Y)], [ca.densify(ca.vertcat(EXPRESSIONS[name], X))])
    values = np.random.default_rng(0).uniform(-1.4, 1.4, (2 * AT_ONCE + 7, 2))
    values[:5, 0] = [0.0, 1.0, -1.0, 0.5, -0.0]
    (made,) = Vectorised(function)(values)
    np.testing.assert_allclose(made, np.array(function(values.T)).T, rtol=1e-13, atol=1e-13)
    few = Vectorised(function)
    for count in (1, FEW, FEW, 1):
        np.testing.assert_allclose(few(values[:count])[0], made[:count], rtol=1e-13, atol=1e-13)
    (again,) = pickle.loads(pickle.dumps(few))(values[:1])
    np.testing.assert_array_equal(again, few(values[:1])[0])


def test_an_operation_without_translation_is_refused() -> None:
    function = ca.Function("f", [X], [ca.erf(X)])
    with pytest.raises(NotImplementedError, match="not translated"):
        Vectorised(function)(np.zeros((FEW + 1, 1)))

"""Evaluates a CasADi function at many states, straight between numpy arrays."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from robot_ident.signals.motion import Array, Motion


class Batch:
    """A function (q, dq, ddq) -> matrix [m, p] at a fixed number N of states."""

    def __init__(self, function: Any, points: int) -> None:
        """Lay the function out for `points` states."""
        n = function.size1_in(0)
        inputs = [ca.SX.sym(name, n) for name in ("q", "dq", "ddq")]
        dense = ca.Function("dense", inputs, [ca.densify(function(*inputs))])
        self._shape = points, function.size2_out(0), function.size1_out(0)
        self._function = dense.map(points)

    def __call__(self, motion: Motion) -> Array:
        """Return the matrices [N, m, p] along a motion of N states."""
        out = np.empty(self._shape)  # CasADi's memory runs down the columns
        buffer, evaluate = self._function.buffer()
        states = [np.ascontiguousarray(state) for state in (motion.q, motion.dq, motion.ddq)]
        for k, state in enumerate(states):
            buffer.set_arg(k, memoryview(state))
        buffer.set_res(0, memoryview(out))
        evaluate()
        return out.transpose(0, 2, 1)

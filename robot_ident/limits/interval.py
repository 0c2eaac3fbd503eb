"""Ranges of a CasADi function over boxes by interval arithmetic (Moore 1966), and its values at many states."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
from scipy.special import erf

from robot_ident.signals.motion import Array, Motion

Range = tuple[Array, Array]
_ROUNDING = 1e-9  # by which results are widened, relative to their size: far beyond what rounding does


class Unbounded(Exception):
    """An instruction has no range here: the function must be looked at in another way."""


class RangeFunction:
    """Encloses the values of a function of scalars over many boxes at once.

    Rising pieces are evaluated at both ends, sin and cos with their crests, sign as [-1, 1] where it jumps. A variable
    that occurs more than once widens the result; the excess vanishes with the size of the box.
    """

    def __init__(self, function: Any) -> None:
        """Take a CasADi function; Unbounded when it has an instruction that isn't known."""
        self._function = f = function if function.is_a("SXFunction") else function.expand()
        self._program = [
            (f.instruction_id(k), tuple(f.instruction_input(k)), tuple(f.instruction_output(k)))
            for k in range(f.n_instructions())
        ]
        codes = [code for code, _, _ in self._program]
        self._constants = [f.instruction_constant(k) if code == ca.OP_CONST else 0.0 for k, code in enumerate(codes)]
        if unknown := set(codes) - {*_BINARY, *_UNARY, *_MOVES}:
            raise Unbounded(f"operations {sorted(unknown)}")

    def __call__(self, boxes: list[Range]) -> list[Range]:
        """Return the range [N, rows] of every output for boxes of inputs, each a pair of [N, rows]."""
        f, work = self._function, {}
        samples = len(boxes[0][0])
        outputs = [np.zeros((2, samples, f.nnz_out(k))) for k in range(f.n_out())]
        with np.errstate(all="ignore"):
            for constant, (code, given, made) in zip(self._constants, self._program, strict=True):
                if code == ca.OP_CONST:
                    value = np.full(1, constant)
                    work[made[0]] = value, value
                elif code == ca.OP_INPUT:
                    low, high = boxes[given[0]]
                    work[made[0]] = low[:, given[1]], high[:, given[1]]
                elif code == ca.OP_OUTPUT:
                    outputs[made[0]][:, :, made[1]] = np.broadcast_arrays(*work[given[0]], np.zeros(samples))[:2]
                elif code in _UNARY:
                    work[made[0]] = _UNARY[code](work[given[0]])
                elif given[0] == given[1] and code == ca.OP_MUL:
                    work[made[0]] = _square(work[given[0]])
                else:
                    work[made[0]] = _BINARY[code](work[given[0]], work[given[1]])
        if not all(np.all(np.isfinite(out)) for out in outputs):
            raise Unbounded("a range without an end")
        slack = [_ROUNDING * (1.0 + np.abs(out).max(axis=0)) for out in outputs]
        return [(out[0] - wide, out[1] + wide) for out, wide in zip(outputs, slack, strict=True)]


def _rising(function: Callable[[Array], Array]) -> Callable[[Range], Range]:
    return lambda x: (function(x[0]), function(x[1]))


def _times(x: Range, y: Range) -> Range:
    if x[0] is x[1]:  # a constant
        a, b = x[0] * y[0], x[0] * y[1]
        return np.minimum(a, b), np.maximum(a, b)
    if y[0] is y[1]:
        return _times(y, x)
    a, b, c, d = x[0] * y[0], x[0] * y[1], x[1] * y[0], x[1] * y[1]
    return np.minimum(np.minimum(a, b), np.minimum(c, d)), np.maximum(np.maximum(a, b), np.maximum(c, d))


def _inverse(x: Range) -> Range:
    through = (x[0] <= 0.0) & (x[1] >= 0.0)
    return np.where(through, -np.inf, 1.0 / x[1]), np.where(through, np.inf, 1.0 / x[0])


def _even(function: Callable[[Array], Array]) -> Callable[[Range], Range]:
    """Return the range of an even function that rises from 0 at 0."""

    def enclosed(x: Range) -> Range:
        a, b = function(x[0]), function(x[1])
        return np.where((x[0] < 0.0) & (x[1] > 0.0), 0.0, np.minimum(a, b)), np.maximum(a, b)

    return enclosed


_square, _size = _even(np.square), _even(np.abs)


def _cosine(x: Range) -> Range:
    """Return the range of cos: its crests are at even multiples of pi, its troughs at odd ones."""
    a, b, turn = np.cos(x[0]), np.cos(x[1]), 2.0 * np.pi
    crest = np.floor(x[1] / turn) >= np.ceil(x[0] / turn)
    trough = np.floor((x[1] - np.pi) / turn) >= np.ceil((x[0] - np.pi) / turn)
    return np.where(trough, -1.0, np.minimum(a, b)), np.where(crest, 1.0, np.maximum(a, b))


def _power(x: Range, y: Range) -> Range:
    """Return x^y for a constant exponent, of a base that is positive or for a whole exponent."""
    exponent = float(np.max(y[0]))
    if not (np.all(y[0] == exponent) and np.all(y[1] == exponent)):
        raise Unbounded("a power that varies")
    if exponent < 0.0:
        return _inverse(_power(x, (-y[1], -y[0])))
    if exponent == round(exponent) and round(exponent) % 2 == 0:
        low, high = _size(x)
        return low**exponent, high**exponent
    return x[0] ** exponent, x[1] ** exponent


_MOVES = (ca.OP_CONST, ca.OP_INPUT, ca.OP_OUTPUT)
_UNARY: dict[int, Callable[[Range], Range]] = {
    ca.OP_ASSIGN: lambda x: x,
    ca.OP_NEG: lambda x: (-x[1], -x[0]),
    ca.OP_SQ: _square,
    ca.OP_TWICE: _rising(lambda x: 2.0 * x),
    ca.OP_SIN: lambda x: _cosine((x[0] - 0.5 * np.pi, x[1] - 0.5 * np.pi)),
    ca.OP_COS: _cosine,
    ca.OP_TANH: _rising(np.tanh),
    ca.OP_SINH: _rising(np.sinh),
    ca.OP_ATAN: _rising(np.arctan),
    ca.OP_ASINH: _rising(np.arcsinh),
    ca.OP_ERF: _rising(erf),
    ca.OP_EXP: _rising(np.exp),
    ca.OP_LOG: _rising(np.log),
    ca.OP_SQRT: _rising(np.sqrt),
    ca.OP_SIGN: _rising(np.sign),
    ca.OP_FABS: _size,
    ca.OP_INV: _inverse,
}
_BINARY: dict[int, Callable[[Range, Range], Range]] = {
    ca.OP_ADD: lambda x, y: (x[0] + y[0], x[1] + y[1]),
    ca.OP_SUB: lambda x, y: (x[0] - y[1], x[1] - y[0]),
    ca.OP_MUL: _times,
    ca.OP_DIV: lambda x, y: _times(x, _inverse(y)),
    ca.OP_POW: _power,
    ca.OP_CONSTPOW: _power,
    ca.OP_FMIN: lambda x, y: (np.minimum(x[0], y[0]), np.minimum(x[1], y[1])),
    ca.OP_FMAX: lambda x, y: (np.maximum(x[0], y[0]), np.maximum(x[1], y[1])),
}


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

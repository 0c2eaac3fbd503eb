"""A CasADi function evaluated at many instants at once: each of its operations runs in numpy on all of them."""

from __future__ import annotations

import threading
from collections.abc import Callable
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from robot_ident.signals.motion import Array

AT_ONCE = 1024
"""Instants a pass: what an operation reads and writes then stays in the processor's cache."""

FEW = 8
"""Instants up to which CasADi's virtual machine is the faster one: for so few, numpy's time goes into its calls."""

_Operation = Callable[..., Array]


_UNARY: dict[int, _Operation] = {
    ca.OP_ASSIGN: np.positive,
    ca.OP_NEG: np.negative,
    ca.OP_EXP: np.exp,
    ca.OP_LOG: np.log,
    ca.OP_SQRT: np.sqrt,
    ca.OP_SQ: np.square,
    ca.OP_TWICE: lambda x: x + x,
    ca.OP_SIN: np.sin,
    ca.OP_COS: np.cos,
    ca.OP_TAN: np.tan,
    ca.OP_ASIN: np.arcsin,
    ca.OP_ACOS: np.arccos,
    ca.OP_ATAN: np.arctan,
    ca.OP_NOT: lambda x: (x == 0).astype(float),
    ca.OP_FLOOR: np.floor,
    ca.OP_CEIL: np.ceil,
    ca.OP_FABS: np.abs,
    ca.OP_SIGN: np.sign,
    ca.OP_INV: np.reciprocal,
    ca.OP_SINH: np.sinh,
    ca.OP_COSH: np.cosh,
    ca.OP_TANH: np.tanh,
    ca.OP_ASINH: np.arcsinh,
}

_BINARY: dict[int, _Operation] = {
    ca.OP_ADD: np.add,
    ca.OP_SUB: np.subtract,
    ca.OP_MUL: np.multiply,
    ca.OP_DIV: np.divide,
    ca.OP_POW: np.power,
    ca.OP_CONSTPOW: np.power,
    ca.OP_LT: lambda x, y: (x < y).astype(float),
    ca.OP_LE: lambda x, y: (x <= y).astype(float),
    ca.OP_EQ: lambda x, y: (x == y).astype(float),
    ca.OP_NE: lambda x, y: (x != y).astype(float),
    ca.OP_AND: lambda x, y: ((x != 0) & (y != 0)).astype(float),
    ca.OP_OR: lambda x, y: ((x != 0) | (y != 0)).astype(float),
    # CasADi's conditional product: zero where the condition is, whatever the other factor.
    ca.OP_IF_ELSE_ZERO: lambda x, y: np.where(x != 0, y, 0.0),
    ca.OP_FMIN: np.fmin,
    ca.OP_FMAX: np.fmax,
    ca.OP_ATAN2: np.arctan2,
    ca.OP_COPYSIGN: np.copysign,
}


class Vectorised:
    """A CasADi function of SX expressions with dense column vectors as inputs and outputs.

    Called with arrays [N, inputs] it returns arrays [N, outputs]; several times faster than a CasADi map, whose
    virtual machine takes the instants one by one.
    """

    def __init__(self, function: Any) -> None:
        """Hold a function; a call raises NotImplementedError where it has an operation that isn't translated."""
        self.function = function
        self._mapped: dict[int, tuple[Any, Any]] = {}
        self._lock = threading.Lock()

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the function alone: what is made of it holds addresses."""
        return Vectorised, (self.function,)

    @cached_property
    def _program(self) -> list[tuple[Any, ...]]:
        f = self.function
        out: list[tuple[Any, ...]] = []
        for k in range(f.n_instructions()):
            op, to, of = f.instruction_id(k), f.instruction_output(k), f.instruction_input(k)
            if op == ca.OP_CONST:
                out.append((0, None, to[0], float(f.instruction_constant(k)), None))
            elif op == ca.OP_INPUT:
                out.append((1, None, to[0], of[0], of[1]))
            elif op == ca.OP_OUTPUT:
                out.append((2, None, to[0], to[1], of[0]))
            elif op in _UNARY:
                out.append((3, _UNARY[op], to[0], of[0], None))
            elif op in _BINARY:
                out.append((4, _BINARY[op], to[0], of[0], of[1]))
            else:
                raise NotImplementedError(f"operation {op} of CasADi is not translated to numpy")
        return out

    def __call__(self, *inputs: Array) -> tuple[Array, ...]:
        """Return the outputs [N, size] for inputs [N, size]."""
        f, samples = self.function, len(inputs[0])
        outputs = tuple(np.zeros((samples, f.size1_out(k))) for k in range(f.n_out()))
        if 0 < samples <= FEW:
            self._run_mapped([np.ascontiguousarray(x, dtype=float) for x in inputs], outputs)
            return outputs
        with np.errstate(all="ignore"):  # branches that aren't taken may divide by zero
            for begin in range(0, samples, AT_ONCE):
                part = slice(begin, begin + AT_ONCE)
                self._run([np.ascontiguousarray(x[part].T) for x in inputs], [y[part] for y in outputs])
        return outputs

    def _run_mapped(self, inputs: list[Array], outputs: tuple[Array, ...]) -> None:
        """Let CasADi take the instants one by one, on numpy's memory; one thread at a time."""
        with self._lock:
            if len(inputs[0]) not in self._mapped:
                self._mapped[len(inputs[0])] = self.function.map(len(inputs[0])).buffer()
            buffer, evaluate = self._mapped[len(inputs[0])]
            for k, values in enumerate(inputs):
                buffer.set_arg(k, memoryview(values))
            for k, values in enumerate(outputs):
                buffer.set_res(k, memoryview(values))
            evaluate()

    def _run(self, inputs: list[Array], outputs: list[Array]) -> None:
        work: list[Any] = [0.0] * self.function.sz_w()
        for kind, operation, a, b, c in self._program:
            if kind == 4:
                work[a] = operation(work[b], work[c])
            elif kind == 3:
                work[a] = operation(work[b])
            elif kind == 0:
                work[a] = np.float64(b)
            elif kind == 1:
                work[a] = inputs[b][c]
            else:
                outputs[a][:, b] = work[c]

"""CasADi functions on numpy's memory, without Python between one instant and the next."""

from __future__ import annotations

import threading
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from robot_ident.signals.motion import Array

BLOCKS = (64, 8, 1)
"""How many instants or steps one call into compiled code runs; any number is put together from these."""


def on_memory(function: Any) -> Callable[..., None]:
    """Return what runs a CasADi function, one thread at a time, on contiguous arrays of floats: its inputs, then its
    outputs, in CasADi's order of memory.
    """
    buffer, evaluate = function.buffer()
    inputs, lock = function.n_in(), threading.Lock()

    def run(*arrays: Array) -> None:
        with lock:  # CasADi keeps addresses alone: the arrays live until the call is over
            for k, values in enumerate(arrays):
                if k < inputs:
                    buffer.set_arg(k, memoryview(values))
                else:
                    buffer.set_res(k - inputs, memoryview(values))
            evaluate()

    return run


def vectorised(function: Any) -> Callable[..., tuple[Array, ...]]:
    """Return what takes arrays [N, inputs] to arrays [N, outputs] by a CasADi function of dense column vectors."""
    mapped = cache(lambda size: on_memory(function.map(size)))

    def run(*inputs: Array) -> tuple[Array, ...]:
        samples, at = len(inputs[0]), 0
        given = [np.ascontiguousarray(x, dtype=float) for x in inputs]
        outputs = tuple(np.empty((samples, function.size1_out(k))) for k in range(function.n_out()))
        for size in BLOCKS:
            while samples - at >= size:
                mapped(size)(*(x[at : at + size] for x in (*given, *outputs)))
                at += size
        return outputs

    return run

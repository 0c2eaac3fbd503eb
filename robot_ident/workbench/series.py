"""What figures are drawn from: the rows of every recording, measured and predicted, with what they depend on."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from robot_ident.diagnosis.residual_lines import ResidualLines
from robot_ident.errors import InputError
from robot_ident.files import whole
from robot_ident.signals.motion import Array, Mask

VARIABLES = ("time", "velocity", "position", "load", "acceleration", "time_since_reversal")
"""What a residual is looked at over; `speed`, the size of the velocity, is brushed as well."""


@dataclass(frozen=True)
class Rows:
    """The rows [N] of one recording: t [s]; q, dq, ddq, since (the last reversal [s]) and measured torque, all [N, n];
    weight [N, n] (1 / Nm, 0 where a row does not count) and dof [n] as `compare` takes them.
    """

    t: Array
    q: Array
    dq: Array
    ddq: Array
    since: Array
    measured: Array
    weight: Array
    dof: Array

    def variable(self, name: str, joint: int, load: Array) -> Array:
        """Return the values [N] of a variable at a joint; load [N, n]: the torque that the gears carry."""
        if name == "time":
            return self.t
        if name == "speed":
            return np.abs(self.dq[:, joint])
        columns = {
            "velocity": self.dq,
            "position": self.q,
            "acceleration": self.ddq,
            "load": load,
            "time_since_reversal": self.since,
        }
        if name not in columns:
            raise InputError(f"{name}: no variable; known: {', '.join((*VARIABLES, 'speed'))}")
        return columns[name][:, joint]


@dataclass(frozen=True)
class Lines:
    """The lines of one recording's residual: frequency [K] Hz; excited [K]: those that the motion itself holds; noise
    [K, n] Nm rms of a line, nan where unknown.
    """

    frequency: Array
    excited: Mask
    noise: Array


def write_arrays(path: Path, arrays: Mapping[str, Array]) -> None:
    """Write named arrays to a file, whole or not at all."""
    with whole(path, force=True) as draft:
        buffer = io.BytesIO()
        np.savez(buffer, **{name: np.asarray(array) for name, array in arrays.items()})  # type: ignore[arg-type]
        draft.write_bytes(buffer.getvalue())


def read_arrays(path: Path) -> dict[str, Array]:
    """Return the arrays of a file."""
    with np.load(path, allow_pickle=False) as file:
        return {name: file[name] for name in file.files}


def rows_to_arrays(rows: Sequence[Rows]) -> dict[str, Array]:
    """Return the rows of all recordings as named arrays."""
    return {f"{k}.{name}": getattr(one, name) for k, one in enumerate(rows) for name in Rows.__dataclass_fields__}


def rows_from_arrays(arrays: Mapping[str, Array]) -> tuple[Rows, ...]:
    """Return the rows of all recordings; the reverse of `rows_to_arrays`."""
    return tuple(
        Rows(**{name: arrays[f"{k}.{name}"] for name in Rows.__dataclass_fields__}) for k in range(_count(arrays))
    )


def lines_to_arrays(lines: Sequence[ResidualLines]) -> dict[str, Array]:
    """Return the frequencies and the noise of all recordings' lines as named arrays."""
    return {f"{k}.{name}": getattr(one, name) for k, one in enumerate(lines) for name in Lines.__dataclass_fields__}


def lines_from_arrays(arrays: Mapping[str, Array]) -> tuple[Lines, ...]:
    """Return the lines of all recordings; the reverse of `lines_to_arrays`."""
    return tuple(
        Lines(arrays[f"{k}.frequency"], arrays[f"{k}.excited"].astype(bool), arrays[f"{k}.noise"])
        for k in range(_count(arrays))
    )


def _count(arrays: Mapping[str, Array]) -> int:
    """Return how many recordings named arrays are of."""
    return len({name.partition(".")[0] for name in arrays})

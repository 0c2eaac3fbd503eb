"""What a robot reported: joint positions and torques with their stamps, as read, nothing interpreted yet."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace

import numpy as np

from robot_ident.errors import InputError
from robot_ident.recording.conditions import Conditions
from robot_ident.signals.motion import Array, Mask, frozen_array

LONGEST = 9e9  # s, of which whole nanoseconds can be counted
LARGEST = 1e12
"""No joint turns that far, no drive pulls that hard, in any unit; squares and sums of more leave double precision."""


@dataclass(frozen=True)
class Recording:
    """Joint states over time, sorted by stamp.

    names: the n joints. t [N] s, strictly increasing, t[0] arbitrary. q [N, n] rad or m. tau [N, n] Nm or N. dq [N,
    n] rad/s as the robot reported it, or None. source: the file, for messages. notes: one line for each thing that
    was repaired or lost while reading. start_ns: the absolute stamp of t = 0 in ns since the clock's epoch, 0 where
    it is not known. conditions: what its sidecar states. pace: how fast the receive times ran beside the stamps, 1 for
    stamps of real time; None where there are none of their own.
    """

    names: tuple[str, ...]
    t: Array
    q: Array
    tau: Array
    dq: Array | None = None
    source: str = "recording"
    notes: tuple[str, ...] = ()
    start_ns: int = 0
    conditions: Conditions = Conditions()
    pace: float | None = None

    def __post_init__(self) -> None:
        """Freeze the arrays; InputError on shapes that disagree, NaN samples or time that stands still."""
        try:
            t = frozen_array(self.t, None)
            q = frozen_array(self.q, len(t), len(self.names))
            tau = frozen_array(self.tau, *q.shape)
            dq = None if self.dq is None else frozen_array(self.dq, *q.shape)
        except ValueError as error:
            raise InputError(f"{self.source}: {error}") from error
        for field, values in (("t", t), ("q", q), ("tau", tau), ("dq", dq)):
            # a NaN is the least and the largest of its array; what is within bounds needs no array of masks
            if values is not None and values.size and not np.isfinite([values.min(), values.max()]).all():
                rows = np.flatnonzero(~np.isfinite(values.reshape(len(t), -1)).all(axis=1))
                where = f"in {len(rows)} of {len(t)} samples, first at t = {t[rows[0]]:.3f} s"
                raise InputError(f"{self.source}: {field} is not a number {where}")
        for field, values in (("q", q), ("tau", tau), ("dq", dq)):
            if values is not None and max(-values.min(initial=0.0), values.max(initial=0.0)) > LARGEST:
                row, joint = np.argwhere(np.abs(values) > LARGEST)[0]
                raise InputError(
                    f"{self.source}: {field} of {self.names[joint]} is {values[row, joint]:.3g} at t = {t[row]:.3f} s;"
                    " that is no measurement"
                )
        if len(t) and t[-1] - t[0] > LONGEST:
            raise InputError(f"{self.source}: it lasts {t[-1] - t[0]:.3g} s; are its times in seconds?")
        if len(t) > 1 and np.any(np.diff(t) <= 0):
            raise InputError(f"{self.source}: time does not increase at sample {int(np.argmax(np.diff(t) <= 0)) + 1}")
        for field, values in (("t", t), ("q", q), ("tau", tau), ("dq", dq)):
            object.__setattr__(self, field, values)

    @property
    def samples(self) -> int:
        """Number of samples N."""
        return len(self.t)

    @property
    def duration(self) -> float:
        """Time from the first to the last sample [s]."""
        return float(self.t[-1] - self.t[0]) if len(self.t) else 0.0

    def __getitem__(self, rows: slice | Mask) -> Recording:
        """Return some of the samples."""
        dq = None if self.dq is None else self.dq[rows]
        return replace(self, t=self.t[rows], q=self.q[rows], tau=self.tau[rows], dq=dq)

    def with_joints(self, joints: tuple[str, ...]) -> Recording:
        """Return the columns of `joints` in that order, matched by name; InputError lists a missing one."""
        if joints == self.names:
            return self
        missing = [name for name in joints if name not in self.names]
        if missing:
            hint = ": is it of another robot? identify --robot names its file" if len(missing) == len(joints) else ""
            hint += "".join(
                f"; {note}" for note in self.notes if re.match(rf"the effort of .*\b{re.escape(missing[0])}\b", note)
            )
            raise InputError(
                f"{self.source}: joint {missing[0]!r} is missing; the recording has {', '.join(self.names)}{hint}"
            )
        pick = [self.names.index(name) for name in joints]
        dq = None if self.dq is None else self.dq[:, pick]
        return replace(self, names=tuple(joints), q=self.q[:, pick], tau=self.tau[:, pick], dq=dq)

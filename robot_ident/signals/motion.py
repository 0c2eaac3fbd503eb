"""Motion of the joints over time: frozen arrays with their units."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


def frozen_array(values: ArrayLike, *shape: int | None) -> Array:
    """Return a read-only float array; ValueError when its shape differs from `shape` (None: any length).

    One that is read-only and owns its numbers already is returned itself.
    """
    array: Array = values if isinstance(values, np.ndarray) and _is_fixed(values) else np.array(values, dtype=float)
    agrees = not shape or array.shape == shape  # the usual case first: in real time there are many of them
    if not agrees and (
        array.ndim != len(shape) or any(s not in (None, got) for s, got in zip(shape, array.shape, strict=True))
    ):
        raise ValueError(f"an array of shape {shape} was expected, got {array.shape}")
    array.setflags(write=False)
    return array


def _is_fixed(array: NDArray[Any]) -> bool:
    return array.dtype == np.float64 and array.flags.owndata and not array.flags.writeable


@dataclass(frozen=True)
class Motion:
    """Position, velocity and acceleration of n joints at N instants.

    q [N, n] rad (m on a prismatic joint), dq [N, n] rad/s, ddq [N, n] rad/s^2. dt [s]: time between the instants,
    None where they don't follow each other evenly. periodic: whether the first instant follows the last. began [s]:
    when after the first sample of their recording the periods began whose mean it is, empty where that is not known.
    gravity [3]: m/s^2 in the base's frame, None: as the robot usually stands.
    """

    q: Array
    dq: Array
    ddq: Array
    dt: float | None = None
    periodic: bool = False
    began: tuple[float, ...] = ()
    gravity: tuple[float, float, float] | None = None

    def __post_init__(self) -> None:
        """Freeze the three arrays and check that they agree."""
        q = frozen_array(self.q, None, None)
        object.__setattr__(self, "q", q)
        object.__setattr__(self, "dq", frozen_array(self.dq, *q.shape))
        object.__setattr__(self, "ddq", frozen_array(self.ddq, *q.shape))

    @property
    def samples(self) -> int:
        """Number of instants N."""
        return self.q.shape[0]

    @property
    def joints(self) -> int:
        """Number of joints n."""
        return self.q.shape[1]

    def __getitem__(self, rows: Any) -> Motion:
        """Return the motion at some of its instants (a slice, mask or index array), which no longer follow each
        other.
        """
        return Motion(self.q[rows], self.dq[rows], self.ddq[rows], gravity=self.gravity)


def joined(motions: Sequence[Motion]) -> Motion:
    """Return the instants of several motions as one, in which they do not all follow each other: what they reach."""
    first = motions[0]
    if len(motions) == 1:
        return first
    q, dq, ddq = (np.concatenate([getattr(motion, name) for motion in motions]) for name in ("q", "dq", "ddq"))
    return Motion(q, dq, ddq, gravity=first.gravity)

"""A running verdict: has the robot changed since the residual was first seen?

The residual of the latest window of time is laid beside that of the first one, joint by joint. Whatever the model lacks
is in both; what differs is a change of the robot. It is sought along the joint's own friction: in each window the
residual r = c sign(dq) + b dq + o is fitted, and the change of (c, b, o) is weighed by its covariance.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

import numpy as np

from robot_ident.signals.motion import Array

_BLOCKS = 10  # of a window: errors of different blocks are taken as independent
_CERTAIN = 36.0  # squared Mahalanobis distance of a change that chance and a motion's own course don't reach
_GROWN = 2.0  # times its first mean square: a residual that has grown whatever along
_TERMS = ("coulomb", "viscous", "offset")


@dataclass(frozen=True)
class Change:
    """Of one joint: rms of the residual in the first and in the latest window [Nm], and what has changed.

    coulomb [Nm], viscous [Nm s/rad], offset [Nm]: change of the fitted coefficients. rms: of the torque that this makes
    in the latest window [Nm]; share: of the torque's own rms. distance: squared, in units of its covariance.
    """

    joint: str
    first_rms: float
    rms: float
    coulomb: float
    viscous: float
    offset: float
    change_rms: float
    share: float
    distance: float

    def changed(self, least: float) -> bool:
        """Whether the change is beyond chance and at least a share of the joint's torque."""
        friction = self.distance > _CERTAIN and self.share >= least
        return friction or self.rms**2 > _GROWN * self.first_rms**2

    @property
    def in_words(self) -> str:
        """What has changed, the largest part first."""
        return (
            f"{self.joint}: coulomb {self.coulomb:+.3g}, viscous {self.viscous:+.3g}, offset {self.offset:+.3g};"
            f" residual {self.first_rms:.3g} -> {self.rms:.3g} rms"
        )


@dataclass
class _Block:
    """Sums over a stretch of time of one window: of columns [n, 3], residual and torque."""

    gram: Array
    right: Array
    power: Array
    torque: Array
    rows: int = 0
    last: float = field(default=-np.inf)

    @classmethod
    def empty(cls, n: int) -> _Block:
        return cls(np.zeros((n, 3, 3)), np.zeros((n, 3)), np.zeros(n), np.zeros(n))

    def add(self, columns: Array, residual: Array, torque: Array) -> None:
        self.gram += np.einsum("tja,tjb->jab", columns, columns)
        self.right += np.einsum("tja,tj->ja", columns, residual)
        self.power += np.sum(residual**2, axis=0)
        self.torque += np.sum(torque**2, axis=0)
        self.rows += len(residual)


class RunningVerdict:
    """Compares the latest window of residuals with the first; memory is that of two windows' sums, whatever the time.

    A window is `window` [s]; of a periodic motion it should hold whole periods.
    """

    def __init__(self, joints: tuple[str, ...], window: float) -> None:
        """Begin with nothing seen."""
        self.joints = joints
        self.window = window
        self._first: list[_Block] = []
        self._latest: deque[_Block] = deque(maxlen=_BLOCKS)
        self._open = _Block.empty(len(joints))
        self._begun: float | None = None

    def add(self, t: Array, dq: Array, residual: Array, torque: Array) -> None:
        """Take in samples at times t [N] s: velocities [N, n], residual and measured torque [N, n] Nm.

        A jump of time by more than a window begins anew.
        """
        finite = np.isfinite(residual).all(axis=1) & np.isfinite(dq).all(axis=1) & np.isfinite(torque).all(axis=1)
        for now in np.flatnonzero(finite):
            if self._begun is None or not 0.0 <= t[now] - self._begun <= 2.0 * self.window:
                if self._begun is not None:
                    self.restart()
                self._begun = float(t[now])
            if t[now] - self._begun >= self.window / _BLOCKS:
                self._close(float(t[now]))
            rows = slice(now, now + 1)
            columns = np.stack([np.sign(dq[rows]), dq[rows], np.ones_like(dq[rows])], axis=2)
            self._open.add(columns, residual[rows], torque[rows])

    def _close(self, now: float) -> None:
        if self._open.rows:
            if len(self._first) < _BLOCKS:
                self._first.append(self._open)
            else:
                self._latest.append(self._open)
        self._open, self._begun = _Block.empty(len(self.joints)), now

    def restart(self) -> None:
        """Forget what was seen: another model, or the robot was changed on purpose."""
        self._first.clear()
        self._latest.clear()
        self._open, self._begun = _Block.empty(len(self.joints)), None

    @property
    def progress(self) -> float:
        """How much of the two windows is filled [0, 1]."""
        return (len(self._first) + len(self._latest)) / (2 * _BLOCKS)

    def changes(self) -> tuple[Change, ...]:
        """Return each joint's change; empty until two windows are full."""
        if len(self._latest) < _BLOCKS:
            return ()
        latest = list(self._latest)
        return tuple(_change(name, j, self._first, latest) for j, name in enumerate(self.joints))


def _change(name: str, joint: int, first: list[_Block], latest: list[_Block]) -> Change:
    before, spread_before, rms_before = _fit(first, joint)
    after, spread_after, rms = _fit(latest, joint)
    delta = after - before
    gram = sum(block.gram[joint] for block in latest)
    rows = max(1, sum(block.rows for block in latest))
    change = float(np.sqrt(max(0.0, float(delta @ gram @ delta) / rows)))
    torque = float(np.sqrt(sum(block.torque[joint] for block in latest) / rows))
    covariance = spread_before + spread_after
    distance = float(delta @ np.linalg.pinv(covariance, rcond=1e-9, hermitian=True) @ delta)
    values = dict(zip(_TERMS, (float(x) for x in delta), strict=True))
    share = change / torque if torque > 0.0 else 0.0
    return Change(name, rms_before, rms, **values, change_rms=change, share=share, distance=distance)


def _fit(blocks: list[_Block], joint: int) -> tuple[Array, Array, float]:
    """Return (c, b, o) of a window, their covariance and the rms of the residual.

    Covariance: white noise's and the sandwich over blocks, added: a motion's own course counts as chance.
    """
    gram = np.sum([block.gram[joint] for block in blocks], axis=0)
    right = np.sum([block.right[joint] for block in blocks], axis=0)
    power = float(sum(block.power[joint] for block in blocks))
    rows = max(1, sum(block.rows for block in blocks))
    inverse = np.linalg.pinv(gram, rcond=1e-9, hermitian=True)
    values = inverse @ right
    left = max(0.0, power - float(values @ right)) / rows
    scores = np.array([block.right[joint] - block.gram[joint] @ values for block in blocks])
    return values, inverse * left + inverse @ (scores.T @ scores) @ inverse, float(np.sqrt(power / rows))

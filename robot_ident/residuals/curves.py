"""What a residual depends on: smooth curves over one variable, judged on motion that they were not fitted to; and what
time reversal says of it: its odd part is dissipative, its even part conservative.

On a motion with q(t0 - t) = q(t0 + t) every position comes twice, with opposite velocities and the same acceleration.
Friction turns its sign between the two, gravity, springs and inertia don't.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from robot_ident.model.structure import Structure
from robot_ident.regression.evidence import Trajectory
from robot_ident.signals.motion import Array, Mask, Motion

_KNOTS = 12  # of a curve: quantiles of its variable
_BLOCKS = 8  # of time, even ones against odd ones, where there is one recording only


@dataclass(frozen=True)
class Variable:
    """Values [N] of a variable along a motion; side [N]: -1 or 1 where either direction of motion has its own curve."""

    values: Array
    side: Array | None = None

    def __getitem__(self, rows: slice) -> Variable:
        """Return some of the rows."""
        return Variable(self.values[rows], None if self.side is None else self.side[rows])

    def signed(self, name: str) -> Array:
        """Return the values; of a velocity, whose curve runs over its size, with their sign."""
        return self.values * self.side if self.side is not None and name.startswith("velocity") else self.values


def variables(structure: Structure, values: Array, motion: Motion, joint: int) -> dict[str, Variable]:
    """Return the variables over which the residual of a joint is looked at.

    Its own position, velocity, speed, acceleration, the load that its gear carries, and the time since it last reversed
    [s]; position and load with a curve for either direction, as friction has; position and velocity of other joints.
    """
    q, dq, ddq = motion.q, motion.dq, motion.ddq
    load = structure.torques(motion, values).load[:, joint]
    side = np.where(dq[:, joint] < 0.0, -1.0, 1.0)
    out = {
        "position": Variable(q[:, joint]),
        "velocity": Variable(np.abs(dq[:, joint]), side),
        "speed": Variable(np.abs(dq[:, joint])),
        "acceleration": Variable(ddq[:, joint]),
        "load": Variable(load),
        "position_and_direction": Variable(q[:, joint], side),
        "load_and_direction": Variable(load, side),
    }
    if motion.dt is not None:
        since = since_reversal(dq[:, joint], motion.dt, periodic=motion.periodic)
        out["time_since_reversal"] = Variable(since, side)
    for other, name in enumerate(structure.robot.joints):
        if other != joint:
            direction = np.where(dq[:, other] < 0.0, -1.0, 1.0)
            out[f"position of {name}"] = Variable(q[:, other])
            out[f"velocity of {name}"] = Variable(np.abs(dq[:, other]), direction)
    return out


def since_reversal(velocity: Array, dt: float, *, periodic: bool) -> Array:
    """Return the time [s] since the velocity [N] last changed its sign; from the start where it hasn't yet.

    periodic: the time before the first change is counted from the last one of the period before.
    """
    turns = np.flatnonzero(np.sign(velocity[1:]) != np.sign(velocity[:-1])) + 1
    rows = np.arange(len(velocity))
    last = np.concatenate([[0], turns])[np.searchsorted(turns, rows, side="right")]
    if periodic and len(turns):
        last = np.where(rows < turns[0], turns[-1] - len(velocity), last)
    return np.asarray((rows - last) * dt)


def held_out_share(along: Sequence[Variable], residual: Sequence[Array], used: Sequence[Mask], excess: float) -> float:
    """Return the share [0, 1] of the excess squared error that a curve over a variable explains on unseen motion.

    The variable, residual [N] and used of every recording. Each recording is predicted by a curve fitted to the others;
    one alone is cut into blocks of time, even ones predicting odd ones and the other way round.
    """
    knots = _knots(along, used)
    if len(knots) < 3 or excess <= 0.0:
        return 0.0
    hats = [hat_functions(one, knots)[u] for one, u in zip(along, used, strict=True)]
    r = [one[u] for one, u in zip(residual, used, strict=True)]
    if len(hats) == 1:
        odd = np.arange(len(r[0])) * _BLOCKS // max(1, len(r[0])) % 2 == 1
        hats, r = [hats[0][odd], hats[0][~odd]], [r[0][odd], r[0][~odd]]
    grams = [h.T @ h for h in hats]
    rights = [h.T @ one for h, one in zip(hats, r, strict=True)]
    fall = 0.0
    for left in range(len(hats)):
        gram, right = sum(grams) - grams[left], sum(rights) - rights[left]
        curve = np.linalg.lstsq(gram, right, rcond=1e-8)[0]
        fall += float(2.0 * curve @ rights[left] - curve @ grams[left] @ curve)
    return float(np.clip(fall / excess, 0.0, 1.0))


def _knots(along: Sequence[Variable], used: Sequence[Mask]) -> Array:
    joined = np.concatenate([one.values[u] for one, u in zip(along, used, strict=True)])
    return np.unique(np.quantile(joined, np.linspace(0.0, 1.0, _KNOTS)))


def hat_functions(variable: Variable, knots: Array) -> Array:
    """Return piecewise linear basis functions [N, knots]; [N, 2 knots], either direction apart, where it has a side."""
    hats = np.column_stack([np.interp(variable.values, knots, row) for row in np.eye(len(knots))])
    if variable.side is None:
        return hats
    forward = (variable.side > 0.0)[:, None]
    return np.hstack([hats * forward, hats * ~forward])


def own(shares: Mapping[str, float], least: float) -> dict[str, float]:
    """Return the shares of a joint's own variables, and those of other joints that reach `least`."""
    return {name: share for name, share in shares.items() if " of " not in name or share >= least}


_TOLERANCE = 0.03  # of a joint's own rms: how far the mirrored motion may be off


def mirror(q: Array) -> np.ndarray | None:
    """Return the row that mirrors each row of a periodic motion q [N, n], or None where no instant mirrors it."""
    x = q - q.mean(axis=0)
    power = np.sum(x**2, axis=0)
    moving = power > 1e-9 * max(float(power.max()), 1e-300)
    spectrum = np.fft.rfft(x[:, moving], axis=0)
    # sum over s of q(s) q(m - s), for every m = 2 t0: |q - its mirror image|^2 = 2 (power - that)
    overlap = np.fft.irfft(spectrum**2, len(q), axis=0)
    off = np.max(np.sqrt(np.maximum(0.0, 2.0 * (1.0 - overlap / power[moving]))), axis=1)
    best = int(np.argmin(off))
    if off[best] > _TOLERANCE:
        return None
    return (best - np.arange(len(q))) % len(q)


def odd_and_even(t: Trajectory, residual: Array, joint: int) -> tuple[float, float] | None:
    """Return the excess squared error of the odd and the even part of a residual [N, n].

    None where the motion has no mirror.
    """
    if not t.motion.periodic or t.measured.decimate != 1:
        return None
    rows = mirror(t.motion.q)
    if rows is None:
        return None
    r = residual[:, joint]
    both = (t.weight[:, joint] > 0) & (t.weight[rows, joint] > 0)
    noise = float(t.dof[joint]) / max(1.0, float(np.sum(t.weight[:, joint] > 0)))
    parts = [np.sum((0.5 * (r + sign * r[rows])[both]) ** 2) - 0.5 * noise * both.sum() for sign in (-1.0, 1.0)]
    return max(0.0, float(parts[0])), max(0.0, float(parts[1]))

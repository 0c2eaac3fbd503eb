"""A gear's gap as it is crossed: the link behind it and the drives before it, simulated along a motion.

All is reckoned from the path that the drives would keep without the gap, z: deviations of the links, e: of the drive
whose gear has the gap. The flanks press by p = |e - z_j| - gap / 2 and carry

    F = (k c(p) + d c'(p) (de/dt - dz_j/dt)) sign(e - z_j),  c = p^2 / (2 b) for 0 < p < b, p - b / 2 beyond:

one tooth after another comes to bear over the bedding b. The load L has to be carried, F = L, but in the gap:

    M z'' = F - L on joint j, -kp z - kd z' on the others;  kd e' + kp e = L - F

(inertia of the motor itself left out against its drive's damping). What drives give in addition is F - L on joint j,
-kp z - kd z' on the others.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from robot_ident.signals.motion import Array

_LONGEST = 3.5e-3  # s: of a step; the implicit midpoint is stable at any
_LARGEST = 1e3  # times the gap: a deviation that no arm has, of estimates that no arm has either


@dataclass(frozen=True)
class Mesh:
    """Flanks of a gear: gap and bedding [rad], stiffness k [Nm/rad] and damping d [Nm s/rad] of the contact."""

    gap: float
    bedding: float
    stiffness: float
    damping: float


@dataclass(frozen=True)
class Drives:
    """How drives hold their path: kp [n] Nm/rad, kd [n] Nm s/rad."""

    stiffness: Array
    damping: Array

    @classmethod
    def of_bandwidth(cls, bandwidth: float, inertia: Array) -> Drives:
        """Return critically damped ones of a bandwidth [Hz] that move inertia [n] kg m^2."""
        w = 2.0 * np.pi * bandwidth
        return cls(inertia * w**2, 2.0 * inertia * w)


class Crossing(NamedTuple):
    """What a gap makes of a motion [N, n]: further torque of the drives [Nm], and how far these give way [rad]."""

    torque: Array
    yielded: Array


def crossing(
    joint: int, load: Array, inertia: Array, mesh: Mesh, drives: Drives, dt: float, *, periodic: bool
) -> Crossing:
    """Return what the gap of a joint's gear makes of a motion with samples every dt [s].

    load [N] Nm: what the gear carries without it. inertia [N, n, n]: of the links, without the rotor before the gap.
    A periodic motion begins in the midst of the longest time between two reversals of the load, at rest on the flank.
    """
    count, n = inertia.shape[:2]
    start = _settled(load) if periodic else 0
    load, inertia = np.roll(load, -start), np.roll(inertia, -start, axis=0)
    upper = np.triu_indices(n)
    steps = max(1, int(np.ceil(dt / _LONGEST)))
    inputs = np.vstack([inertia[:, upper[0], upper[1]].T, load, np.append(load[1:], load[0] if periodic else load[-1])])
    values = [mesh.gap / 2, mesh.bedding, mesh.stiffness, mesh.damping, dt / steps]
    constant = np.tile(np.concatenate([values, drives.stiffness, drives.damping])[:, None], (1, count))
    first = np.zeros(2 * n + 1)
    first[joint] = -np.sign(load[0]) * (mesh.gap + mesh.bedding) / 2 - load[0] / mesh.stiffness
    states, torques = (np.array(x).T for x in _course(n, joint, steps, count)(first, inputs, constant))
    states, torques = np.vstack([first, states[:-1]]), np.vstack([torques[-1] if periodic else 0 * first[:n], torques])
    if not np.all(np.isfinite(states)) or np.abs(states[:, joint]).max() > _LARGEST * mesh.gap:
        return Crossing(np.zeros((count, n)), np.zeros((count, n)))
    yielded = states[:, :n].copy()
    yielded[:, joint] = states[:, 2 * n]
    return Crossing(np.roll(torques[:-1], start, axis=0), np.roll(yielded, start, axis=0))


def _settled(load: Array) -> int:
    """Return the sample in the midst of the longest time without a reversal of the load [N], periodically."""
    turns = np.flatnonzero(np.sign(load) != np.sign(np.roll(load, 1)))
    if not len(turns):
        return 0
    apart = np.diff(np.append(turns, turns[0] + len(load)))
    longest = int(np.argmax(apart))
    return int(turns[longest] + apart[longest] // 2) % len(load)


@lru_cache(maxsize=16)
def _course(n: int, joint: int, steps: int, count: int) -> Any:
    """Return the CasADi function (state, [inputs] [.., N], [constants] [.., N]) -> states and torques after each of N
    samples.
    """
    return _sample(n, joint, steps).mapaccum("course", count)


@lru_cache(maxsize=16)
def _sample(n: int, joint: int, steps: int) -> Any:
    """Return the function from one sample to the next: (z, z', e) and the drives' further torque [n] there."""
    import casadi as ca

    state, size = ca.SX.sym("x", 2 * n + 1), n * (n + 1) // 2
    given, constant = ca.SX.sym("u", size + 2), ca.SX.sym("p", 5 + 2 * n)
    half, bedding, k, d, h = ca.vertsplit(constant[:5])
    kp, kd = constant[5 : 5 + n], constant[5 + n :]
    others = ca.DM([float(i != joint) for i in range(n)])
    inertia = _symmetric(given[:size], n)
    z, v, e = state[:n], state[n : 2 * n], state[2 * n]
    held = ca.diag(others * (kd / 2 + kp * h / 4))
    for number in range(steps):
        load = given[size] + (given[size + 1] - given[size]) * (number + 0.5) / steps
        side, press = _flank(e - z[joint] - h / 2 * v[joint], half)
        stiff = k * ca.if_else(press < bedding, press / (2 * bedding), 1 - bedding / (2 * ca.fmax(press, bedding)))
        damp = d * ca.fmin(press / bedding, 1)
        # implicit midpoint: F = rest + by_drive e_next - by_link v_next
        by_drive, by_link = stiff / 2 + damp / h, stiff * h / 4 + damp / 2
        rest = stiff * (e / 2 - z[joint] - h / 4 * v[joint] - side * half) - damp * (e / h + v[joint] / 2)
        drive = kd[joint] / h + kp[joint] / 2 + by_drive
        given_way = (kd[joint] / h - kp[joint] / 2) * e - rest + load
        matrix = inertia / h + held
        right = ca.mtimes(inertia, v) / h - others * (kp * (z + h / 4 * v) + kd * v / 2)
        matrix[joint, joint] += by_link * (1 - by_drive / drive)
        right[joint] += rest - load + by_drive * given_way / drive
        after = ca.ldl_solve(right, *ca.ldl(matrix))
        z, v, e = z + h / 2 * (v + after), after, (given_way + by_link * after[joint]) / drive
    load = given[size + 1]
    side, press = _flank(e - z[joint], half)
    spring = k * side * ca.if_else(press < bedding, press**2 / (2 * bedding), press - bedding / 2)
    damp = d * ca.fmin(press / bedding, 1)
    force = (spring + damp * ((load - kp[joint] * e) / kd[joint] - v[joint])) / (1 + damp / kd[joint])
    torque = -others * (kp * z + kd * v)
    torque[joint] = force - load
    return ca.Function("sample", [state, given, constant], [ca.vertcat(z, v, e), torque], {"cse": True})


def _flank(twist: Any, half: Any) -> tuple[Any, Any]:
    """Return which flank bears, +-1, and by how much it is pressed."""
    import casadi as ca

    return ca.sign(twist), ca.fmax(ca.fabs(twist) - half, 0)


def _symmetric(upper: Any, n: int) -> Any:
    import casadi as ca

    out, place = ca.SX(n, n), 0
    for i in range(n):
        for j in range(i, n):
            out[i, j] = out[j, i] = upper[place]
            place += 1
    return out

"""Friction and contact with memory, integrated along a periodic path until it repeats."""

from __future__ import annotations

import numpy as np

from foreign.arm import Array, Path, differentiated, model


def lugre(v: Array, x0: float, dt: float) -> Array:
    """Return the bristles' force over Coulomb's: dz = v - |v| z / x0 with micro-damping (Canudas de Wit et al. 1995).

    The damping falls with speed, as it has to for the law to be passive.
    """
    z = 0.0
    out = np.zeros(len(v))
    for _ in range(2):
        for k, speed in enumerate(v):
            z = (z + dt * speed) / (1 + dt * abs(speed) / x0)
            out[k] = z / x0 + 0.3 * (speed - abs(speed) * z / x0) * 0.01 / x0 * np.exp(-((speed / 0.01) ** 2))
    return out


def dahl(v: Array, x0: float, dt: float) -> Array:
    """Return the state of Dahl's law of exponent 2: dz = v / x0 (1 - z sign(v))^2 sign(1 - z sign(v)), implicit."""
    z = 0.0
    out = np.zeros(len(v))
    for _ in range(2):
        for k, speed in enumerate(v):
            s = 1.0 if speed >= 0 else -1.0
            room = 1 - s * z  # d room = -room^2 |v| / x0: exact over the step
            z = s * (1 - room / (1 + room * abs(speed) * dt / x0))
            out[k] = z
    return out


def slipping(q: Array, reach: float, count: int = 10) -> Array:
    """Return the mean of elements that stick up to reaches spread evenly below twice `reach`."""
    reaches = 2 * reach * (np.arange(count) + 0.5) / count
    z = np.zeros(count)
    out = np.zeros(len(q))
    moved = np.diff(q, prepend=q[-1])
    for _ in range(2):
        for k, step in enumerate(moved):
            z = np.minimum(np.maximum(z + step, -reaches), reaches)
            out[k] = np.mean(z / reaches)
    return out


def gapped(driven: Path, load: Array, joint: int, gap: float, stiffness: float, damping: float) -> Path:
    """Return the link's path [N, 3] behind a gap, where its drive moves along `driven`.

    The flanks meet as Hunt and Crossley's contact, k p^1.2 (1 + d rate); inertia and all other torque of the link are
    those at the drive's position: M x'' = contact(drive - link) - (load - M ddq).
    """
    import pinocchio as pin

    arm, data = model()
    inertia = np.array([np.array(pin.crba(arm, data, q))[joint, joint] for q in driven.q[::10]]).repeat(10)
    dt, steps = driven.dt, len(load)
    rest = load - inertia * driven.ddq[:, joint]
    fine = 4
    h = dt / fine
    # deviation e = link - drive: e'' = (contact(-e, -e') - rest) / M - ddq of the drive = (contact - load) / M
    out = np.zeros(steps)
    e, rate = -np.sign(load[0]) * (gap / 2 + abs(load[0]) / stiffness), 0.0
    for _ in range(2):
        for k in range(steps):
            mass, carried = inertia[k], rest[k] + inertia[k] * driven.ddq[k, joint]
            for _ in range(fine):
                press = abs(e) - gap / 2
                contact = 0.0
                if press > 0:
                    side = -1.0 if e > 0 else 1.0  # a link ahead of its drive is held back
                    contact = side * stiffness * press
                    contact -= damping * 2 * np.sqrt(stiffness * mass) * rate
                rate += h * (contact - carried) / mass
                e += h * rate
            out[k] = e
    q = driven.q.copy()
    q[:, joint] += out
    return differentiated(q, driven.period)

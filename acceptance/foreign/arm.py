"""The first three axes of the KUKA IR 361 from the published figures, by Pinocchio's recursive Newton-Euler."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import pinocchio as pin

Array = np.ndarray[Any, np.dtype[np.float64]]

VISCOUS = np.array([17.76, 33.48, 23.11])  # Nm s/rad
COULOMB = np.array([35.12, 6.35, 14.51])  # Nm
ARMATURE = np.array([4.0, 6.0, 0.0])  # kg m^2 on the joint side
GEAR = np.array([94.147, 103.235, 51.441])
TORQUE_VARIANCE = np.array([400.0, 416.0, 160.0])  # (Nm)^2, one sample
POSITION_VARIANCE = 16 * np.array([1.1223e-10, 8.2822e-11, 2.9061e-10])  # rad^2, one sample
TORQUE_LIMIT = np.array([393.0, 443.0, 223.0])  # Nm

_LINKS = (
    (60.0, (0.0, 0.0, 0.0), (1.6016, 0.0, 0.0, 1.6016, 0.0, 1.6016)),
    (100.0, (-0.2431, -0.0222, 0.0227), (8.229, 0.840, -0.705, 19.539, 3.310, 18.261)),
    (50.0, (0.0014, 0.0520, 0.0020), (10.273, 0.0736, -0.210, 2.758, 0.695, 7.595)),
)


@dataclass(frozen=True)
class Path:
    """Joint angles, velocities, accelerations [N, 3], evenly over one period T [s]."""

    q: Array
    dq: Array
    ddq: Array
    period: float

    @property
    def dt(self) -> float:
        return self.period / len(self.q)

    def every(self, step: int) -> Path:
        return Path(self.q[::step], self.dq[::step], self.ddq[::step], self.period)


@lru_cache(maxsize=8)
def model(gravity: tuple[float, float, float] = (0.0, 0.0, -9.81)) -> tuple[Any, Any]:
    """Return the arm in a field of gravity; axes by modified DH, see section IV of the paper."""
    arm = pin.Model()
    arm.gravity.linear = np.array(gravity)
    turn = pin.utils.rotate
    places = (
        pin.SE3(np.eye(3), np.array([0.0, 0.0, 1.020])),
        pin.SE3(turn("x", -np.pi / 2) @ turn("z", -np.pi / 2), np.zeros(3)),
        pin.SE3(turn("z", -np.pi / 2), np.array([0.480, 0.0, 0.0])),
    )
    parent = 0
    for number, (place, (mass, centre, (xx, xy, xz, yy, yz, zz))) in enumerate(zip(places, _LINKS, strict=True), 1):
        parent = arm.addJoint(parent, pin.JointModelRZ(), place, f"joint_{number}")
        tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        arm.appendBodyToJoint(parent, pin.Inertia(mass, np.array(centre), tensor), pin.SE3.Identity())
    return arm, arm.createData()


def links_torque(path: Path, gravity: tuple[float, float, float] = (0.0, 0.0, -9.81)) -> Array:
    """Return the torque [N, 3] that moves the links, without rotors and friction."""
    arm, data = model(gravity)
    rows = zip(path.q, path.dq, path.ddq, strict=True)
    return np.array([pin.rnea(arm, data, q, v, a) for q, v, a in rows])


def regressor(path: Path) -> Array:
    """Return the columns [N, 3, 36] of all links' parameters and of viscous and Coulomb friction."""
    arm, data = model()
    rows = zip(path.q, path.dq, path.ddq, strict=True)
    rigid = np.array([pin.computeJointTorqueRegressor(arm, data, q, v, a) for q, v, a in rows])
    own = np.eye(3)
    viscous, dry = path.dq[:, :, None] * own, np.sign(path.dq)[:, :, None] * own
    return np.concatenate([rigid, viscous, dry], axis=2)


def differentiated(q: Array, period: float) -> Path:
    """Return the path of periodic positions [N, 3], its derivatives by their Fourier series."""
    w = 2j * np.pi * np.arange(len(q) // 2 + 1)[:, None] / period
    lines = np.fft.rfft(q, axis=0)
    first, second = (np.fft.irfft(lines * w**k, len(q), axis=0) for k in (1, 2))
    return Path(q, first, second, period)

"""What is designed: a robot's regressor, its limits, the family of motions and the criterion, as one value."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from robot_ident.design.criteria import line_deviations
from robot_ident.errors import InputError
from robot_ident.model.structure import Structure
from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Array, Motion
from robot_ident.trajectories.excitation import Excitation, check_sampling
from robot_ident.trajectories.fourier_series import FourierSeries

SIGN_WIDTH = 0.035  # width of the smooth sign as a share of the speed that a joint can reach
HARMONICS = 5  # free ones, where nothing else is asked for
_MOST = 60  # free harmonics
_HIGHEST = 400  # order
_FASTEST = 1e5  # Hz


@dataclass(frozen=True)
class Family:
    """The motions that are searched: Fourier series whose harmonics `orders` are free, the others zero.

    symmetric: q(-t) = q(t), cosines of the position alone (a = 0 in eq. 11).
    """

    base_frequency: float
    orders: tuple[int, ...]
    sample_rate: float
    symmetric: bool = False

    @property
    def harmonics(self) -> int:
        """Highest order."""
        return self.orders[-1]

    @property
    def period(self) -> float:
        """Period [s]."""
        return 1.0 / self.base_frequency

    @property
    def samples(self) -> int:
        """Samples a period."""
        return round(self.sample_rate / self.base_frequency)

    @property
    def free(self) -> np.ndarray:
        """Rows that vary in a table of coefficients [1 + 2 L, n] (q0, a_1.., b_1..)."""
        orders = np.array(self.orders)
        waves = self.harmonics + orders if self.symmetric else np.concatenate([orders, self.harmonics + orders])
        return np.concatenate([[0], waves])

    def series(self, coefficients: Array) -> FourierSeries:
        """Return the series of coefficients [1 + 2 L, n]."""
        q0, a, b = np.split(coefficients, [1, 1 + self.harmonics])
        return FourierSeries(self.base_frequency, q0[0], a.T, b.T)

    def excitation(self, robot: Robot, coefficients: Array) -> Excitation:
        """Return the excitation of a robot with coefficients [1 + 2 L, n]."""
        return Excitation(robot.name, robot.joints, self.series(coefficients), self.sample_rate)

    def bases(self, t: Array, highest: int) -> list[Array]:
        """Return what multiplies the coefficients in q and derivatives up to the highest (4) [N, 1 + 2 L] at t [N]."""
        w = 2.0 * np.pi * self.base_frequency * np.arange(1, self.harmonics + 1)
        sin, cos = np.sin(np.outer(t, w)), np.cos(np.outer(t, w))
        first = np.ones((len(t), 1))
        # derivatives of sin(w t) / w and -cos(w t) / w
        waves = [(sin, -cos), (cos, sin), (-sin, cos), (-cos, -sin), (sin, -cos)]
        sizes = [w ** float(order - 1) for order in range(highest + 1)]
        return [
            np.hstack([first if order == 0 else 0.0 * first, a * size, b * size])
            for order, ((a, b), size) in enumerate(zip(waves, sizes, strict=False))
        ]

    def motion(self, coefficients: Array, points: int) -> Motion:
        """Return the motion at `points` instants of a period."""
        motion = self.series(coefficients).motion(np.arange(float(points)) / points * self.period)
        return Motion(motion.q, motion.dq, motion.ddq, dt=self.period / points, periodic=True)

    def reachable_speed(self, robot: Robot) -> Array:
        """Return the speed [n] rad/s that a joint can reach within its limits at the lowest frequency."""
        limits, w = robot.limits, 2.0 * np.pi * self.base_frequency * self.orders[0]
        return np.minimum(limits.velocity, np.minimum(limits.acceleration / w, 0.5 * (limits.upper - limits.lower) * w))


@dataclass(frozen=True)
class Setting:
    """What is designed for, and how.

    structure, values: the model's columns; values [p] (None: unknown) where they depend on them. smooth: columns with a
    smooth sign, CasADi function of a state; exact: with the exact one, None where only samples along time give them.
    variances [n] (Nm)^2 of the torque's noise of one averaged period. criterion: `d-optimal`, `condition` or `crlb`.
    poses [K, n]: where the rules are kept, for starts. torque: the torque that a state takes (CasADi function), where
    it can come near its limit. floor: largest log10 det of the covariance (condition number only). prior [p, p]:
    information that is there already. slopes, exact_slopes: the torque's derivatives [n, 3 n], and
    position_variances [n] rad^2, for `crlb`.
    """

    robot: Robot
    family: Family
    structure: Structure
    smooth: Any
    exact: Any
    variances: Array
    criterion: str
    poses: Array
    values: Array | None = None
    torque: Any = None
    torque_joints: tuple[int, ...] = ()
    floor: float | None = None
    prior: Array | None = None
    slopes: Any = None
    exact_slopes: Any = None
    position_variances: Array | None = None

    @property
    def parameters(self) -> int:
        """Number of parameters p."""
        return len(self.structure.parameters)

    @property
    def line_deviations(self) -> Array:
        """Standard deviations [n (1 + 2 L)] of the lines' amplitudes as positions tell them (`crlb` only)."""
        assert self.position_variances is not None
        return line_deviations(self.family.orders, self.position_variances, self.family.samples)

    @property
    def brief(self) -> bool:
        """Whether a column comes in bursts that need a fine grid."""
        return any(effect.brief for effect in self.structure.effects)


def family_of(
    base_frequency: float,
    sample_rate: float,
    harmonics: int | None = None,
    bandwidth: tuple[float, float] | None = None,
    symmetric: bool = False,
) -> Family:
    """Return the motions with the first harmonics (5), or with as many spread evenly over a bandwidth (lowest, highest)
    Hz.

    Raises InputError where the samples don't carry them, or no harmonic falls inside.
    """
    count = harmonics or HARMONICS
    if count > _MOST or sample_rate > _FASTEST:
        raise InputError(
            f"harmonics = {count}, sample_rate = {sample_rate:g} Hz:"
            f" at most {_MOST} and {_FASTEST:g} Hz are designed for"
        )
    if bandwidth is None:
        check_sampling(base_frequency, sample_rate, count)
        return Family(base_frequency, tuple(range(1, count + 1)), sample_rate, symmetric)
    lowest, highest = bandwidth
    if not 0.0 <= lowest < highest < np.inf:
        raise InputError(f"bandwidth {lowest:g}:{highest:g} Hz: LO:HI with 0 <= LO < HI was expected")
    first = max(1, int(np.ceil(lowest / base_frequency - 1e-9)))
    last = int(np.floor(highest / base_frequency + 1e-9))
    if last < first:
        raise InputError(
            f"bandwidth {lowest:g}:{highest:g} Hz holds no harmonic of {base_frequency:g} Hz (the nearest are at"
            f" {(first - 1) * base_frequency:g} and {first * base_frequency:g} Hz): widen it, or lower --base-frequency"
        )
    if last > _HIGHEST:
        raise InputError(
            f"bandwidth {lowest:g}:{highest:g} Hz reaches harmonic {last} of {base_frequency:g} Hz;"
            f" at most {_HIGHEST} are designed for: raise --base-frequency"
        )
    chosen = np.unique(np.round(np.linspace(first, last, min(count, last - first + 1))).astype(int))
    check_sampling(base_frequency, sample_rate, int(chosen[-1]))
    return Family(base_frequency, tuple(int(order) for order in chosen), sample_rate, symmetric)

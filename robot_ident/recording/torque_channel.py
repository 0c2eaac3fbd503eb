"""The measuring chain of the torque: from what the drive reports back to the torque at the instant of the position."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from robot_ident.errors import InputError
from robot_ident.robot.anti_alias import AntiAlias, Response
from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Array

LEAST_GAIN = 0.5  # of a filter that is inverted: beyond, noise would be more than doubled


@dataclass(frozen=True)
class Chain:
    """What lies between the torque and its record, by joint: an analogue low pass [n] or None, a delay [n] s."""

    anti_alias: tuple[AntiAlias | None, ...]
    delay: Array

    @property
    def trivial(self) -> bool:
        """Whether the torque is recorded as it is."""
        return not self.filtered and not self.delay.any()

    @property
    def filtered(self) -> bool:
        """Whether any joint's torque passes a filter."""
        return any(self.anti_alias)

    @property
    def bandwidth(self) -> float:
        """Frequency [Hz] up to which all filters pass at least half; inf without."""
        return min((kind.passes(LEAST_GAIN) for kind in self.anti_alias if kind), default=float("inf"))

    def response(self, frequency: Array) -> Response:
        """Return H [K, n] at frequencies [K] Hz: the filters' poles, and exp(-i w delay)."""
        lag = np.exp(-2j * np.pi * frequency[:, None] * self.delay)
        gains = {kind: kind.response(frequency) for kind in set(self.anti_alias) if kind}
        for joint, kind in enumerate(self.anti_alias):
            if kind:
                lag[:, joint] *= gains[kind]
        return np.asarray(lag)

    def undone(self, x: Array, rate: float) -> Array:
        """Return torque x [N, n] sampled at `rate` [Hz] without the chain, a low pass below its bandwidth to follow.

        Works on the signal continued at both ends by its odd reflection; the first and last moments stay disturbed.
        """
        pad = min(len(x) - 1, int(2.0 * rate))
        long = np.concatenate([2.0 * x[0] - x[pad:0:-1], x, 2.0 * x[-1] - x[-2 : -pad - 2 : -1]])
        frequency = np.asarray(np.fft.rfftfreq(len(long), 1.0 / rate), dtype=float)
        h = self.response(frequency)
        bounded = h / np.minimum(1.0, np.abs(h) / LEAST_GAIN)  # beyond the bandwidth as large as at its edge
        return np.fft.irfft(np.fft.rfft(long, axis=0) / bounded, len(long), axis=0)[pad : pad + len(x)]

    def check_low_pass(self, cutoff: float, source: str) -> None:
        """Raise InputError where a low pass [Hz] keeps more than can be undone."""
        if cutoff > self.bandwidth:
            raise InputError(
                f"{source}: low pass of {cutoff:g} Hz lies above {self.bandwidth:.3g} Hz, up to which the anti-alias"
                " filter can be undone"
            )

    @property
    def note(self) -> str:
        """A line for the user, empty where there is nothing to say."""
        parts = []
        kinds = [kind for kind in dict.fromkeys(self.anti_alias) if kind]
        if kinds:
            parts.append(f"{', '.join(kind.words for kind in kinds)} undone to {self.bandwidth:.3g} Hz")
        if self.delay.any():
            parts.append("delay of " + ", ".join(f"{1e3 * d:g}" for d in self.delay) + " ms undone")
        return "torque channel: " + ", ".join(parts) if parts else ""


def chain_of(robot: Robot, anti_alias: tuple[float, float] | None, source: str, rate: float, lowest: float) -> Chain:
    """Return the chain that a robot declares; `anti_alias` (order, Hz) replaces its filters, order 0 takes them away.

    Raises InputError where a cutoff is not below half of the sample rate, and where a filter passes less than half of
    the `lowest` frequency [Hz] that the recording holds.
    """
    kinds = robot.anti_alias or (None,) * robot.n
    if anti_alias is not None:
        kinds = (AntiAlias(int(anti_alias[0]), float(anti_alias[1])) if anti_alias[0] else None,) * robot.n
    kind = max((kind for kind in kinds if kind), key=lambda k: k.cutoff, default=None)
    if kind is not None and kind.cutoff > 0.4999 * rate:
        raise InputError(
            f"{source}: the anti-alias filter's cutoff of {kind.cutoff:g} Hz is not below half the sample rate,"
            f" {0.5 * rate:g} Hz; give the filter that was in the chain (--anti-alias ORDER:HZ, or none)"
        )
    chain = Chain(kinds, np.broadcast_to(np.asarray(robot.torque_delay, dtype=float), (robot.n,)))
    if chain.bandwidth < lowest:
        raise InputError(
            f"{source}: the anti-alias filter passes less than half above {chain.bandwidth:.3g} Hz, and the motion"
            f" begins at {lowest:.3g} Hz; give the filter that was in the chain (--anti-alias ORDER:HZ, or none)"
        )
    return chain

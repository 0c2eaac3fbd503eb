"""What the sensors make of the exact motion and torque: noise and quantisation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from robot_ident.errors import InputError
from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Array


@dataclass(frozen=True)
class Sensors:
    """Independent Gaussian noise of each sample (Swevers et al. 1997, eq. 2), then the encoder's steps.

    torque [n] Nm, position [n] rad and velocity [n] rad/s: standard deviations; encoder_step [n] rad, 0 where there is
    none. Velocity is the drive's own: noise as of a difference of two position readings one sample apart, without its
    delay.
    """

    torque: Array
    position: Array
    velocity: Array
    encoder_step: Array

    @classmethod
    def of(cls, robot: Robot, sample_rate: float, noise: float = 1.0) -> Sensors:
        """Return a robot's sensors at a sample rate [Hz]; `noise` multiplies its variances, unknown ones are none."""
        if not 0 <= noise < np.inf:
            raise InputError(f"noise {noise}: a factor of the robot's noise variance, not negative, is needed")
        torque = noise * np.nan_to_num(robot.noise.torque_variance)
        position = noise * np.nan_to_num(robot.noise.position_variance)
        step = robot.drives.encoder_step
        velocity = 2 * (position + step**2 / 12) * sample_rate**2
        return cls(np.sqrt(torque), np.sqrt(position), np.sqrt(velocity), step)

    def read_position(self, q: Array, rng: np.random.Generator) -> Array:
        """Return noisy and quantised positions of q [..., n] rad."""
        noisy = q + self.position * rng.standard_normal(q.shape)
        step = np.where(self.encoder_step > 0, self.encoder_step, 1.0)
        return np.where(self.encoder_step > 0, np.round(noisy / step) * step, noisy)

    def read_velocity(self, dq: Array, rng: np.random.Generator) -> Array:
        """Return noisy velocities of dq [..., n] rad/s."""
        return dq + self.velocity * rng.standard_normal(dq.shape)

    def read_torque(self, tau: Array, rng: np.random.Generator) -> Array:
        """Return noisy torques of tau [..., n] Nm."""
        return tau + self.torque * rng.standard_normal(tau.shape)

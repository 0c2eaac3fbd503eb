"""Play in the teeth."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from robot_ident.effects.along_time import delayed, step
from robot_ident.effects.effect import Coefficient, Course, Effect, Inner, Mathematics, Signals, Torques, scaled
from robot_ident.motion import Array, Motion

_SLOWEST = 1e-3  # Nm/s: a load that changes more slowly takes long to reverse


class Backlash(Effect):
    """A gap between the teeth: after the load reverses the motor crosses it with nothing to drive, then meets the other
    flank.

    Seen from the motor the link stands off by half the gap against the load, q - gap sign(tauL) / 2, and changes sides
    within `width`, after the load has reversed: column -D[tau] of that step, smoothed by a Gaussian. The true course
    of the impact depends on servo and damping, so the column finds its size rather than its shape; bursts are
    recognised by where their energy lies.
    """

    name = "backlash"
    equation = "-gap D[tau](sign(tauL) / 2, crossed within width)"
    meaning = "play of the gear, crossed when the load reverses"
    coefficients = (Coefficient("gap", "mrad", "mm", positive=True),)
    inner = (Inner("width", "s", "s", 0.005, 0.15, (0.01, 0.02, 0.03, 0.045, 0.065, 0.09), logarithmic=True),)
    symmetry = "memory"
    signature = "bursts above 5 Hz after the load reverses"
    confused_with = ("joint_elasticity", "presliding")
    also_like = ("flexibility of the mesh",)
    experiment = "choose postures that preload the gear: without a reversal of the load the bursts go"
    magnitude = "gap 0.3-3 mrad: bursts of 1-20 / 0.1-2 Nm"
    uses_torque = True
    needs_time = True
    symbolic = False
    brief = True
    regression = False
    evidence = (
        "a third or more of the residual's energy lies above 5 Hz, most of that after load reversals, as its column"
    )

    def full_columns(self, motion: Motion, torques: Torques | None = None) -> Array:
        """Return -D[tau] of the smoothed step, Nm per mrad of gap."""
        from scipy.ndimage import gaussian_filter1d

        if torques is None or torques.rigid is None:
            return np.zeros((motion.samples, self.robot.n, 1))
        dt, width = step(motion), self.setting["width"]
        late = delayed(0.5 * np.sign(torques.load[:, self.joint]), motion, width)
        mode = "wrap" if motion.periodic else "nearest"
        side = np.zeros((3, motion.samples, self.robot.n))
        for order in range(3):
            smooth = gaussian_filter1d(late, max(width / (2 * dt), 0.7), order=order, mode=mode)
            side[order, :, self.joint] = smooth / dt**order
        return -1e-3 * torques.rigid.displaced(Motion(*side))[:, :, None]

    def smooth_terms(self, x: Signals, m: Mathematics, course: Course) -> Sequence[dict[int, Any]]:
        """Return -D[tau] of the step as it passes where the load reverses at a rate dtauL: tanh(c (t - t0)) / 2 with
        t - t0 = tauL / dtauL, as steep as the Gaussian.
        """
        width = self.setting["width"]
        load, rate = (course.at(y, -width) for y in (x.load[self.joint], course.rate(x.load[self.joint])))
        slope = m.sqrt(rate**2 + _SLOWEST**2)
        steep = (2.0 / np.pi) ** 0.5 / (0.5 * width)
        side = 0.5 * m.tanh(steep * load / slope)
        first = 0.5 * steep * (1.0 - 4.0 * side**2) * rate / slope
        second = -4.0 * side * steep * first * rate / slope
        return [scaled(-1e-3, course.displaced(self.joint, (side, first, second)))]

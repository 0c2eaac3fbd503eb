"""Play in the teeth."""

from __future__ import annotations

import numpy as np

from robot_ident.effects.along_time import delayed, step
from robot_ident.effects.effect import Coefficient, Effect, Inner, Torques
from robot_ident.motion import Array, Motion


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
    inner = (Inner("width", "s", "s", 0.005, 0.1, (0.01, 0.02, 0.04), logarithmic=True),)
    symmetry = "memory"
    signature = "bursts above 5 Hz after the load reverses"
    confused_with = ("joint_elasticity", "presliding")
    also_like = ("flexibility of the mesh",)
    experiment = "choose postures that preload the gear: without a reversal of the load the bursts go"
    magnitude = "gap 0.3-3 mrad: bursts of 1-20 / 0.1-2 Nm"
    uses_torque = True
    needs_time = True
    symbolic = False
    regression = False
    evidence = "more than 60 % of the residual's energy lies above 5 Hz, and more than 90 % of that near load reversals"

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

"""Friction that falls as the gear warms up."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from robot_ident.effects.effect import Coefficient, Course, Effect, Inner, Mathematics, Signals, Torques
from robot_ident.errors import InputError
from robot_ident.signals.derivatives import step
from robot_ident.signals.motion import Array, Motion

_HIDDEN = "a periodic motion shows no drift but from period to period, and when its periods were is not known"
_SHORT = 0.02  # of T0: friction changes by this share over the recording


class TemperatureDrift(Effect):
    """Lubricant that thins as it warms: tau = b dq exp(-t / T0), what viscous friction is above its warm value at a
    time t after the start of the recording.

    In the average over periods it is viscous friction, of the mean of exp(-t / T0) over them; it trends from period to
    period.
    """

    name = "temperature_drift"
    equation = "b dq exp(-t / T0)"
    meaning = "viscous friction beyond its warm value"
    coefficients = (Coefficient("viscous", "Nm s/rad", "N s/m", positive=True),)
    inner = (Inner("T0", "s", "s", 10.0, 10000.0, (30.0, 100.0, 300.0, 1000.0, 3000.0), logarithmic=True),)
    symmetry = "dissipative"
    signature = "a trend over the periods, nothing in their average"
    confused_with = ("viscous", "viscous_nonlinear")
    also_like = ("wear",)
    experiment = "repeat the recording warm: wear stays, temperature's part is gone"
    magnitude = "20-60 % of viscous friction / the same"
    needs_time = True
    trends = True
    symbolic = False
    evidence = "viscous friction of the single periods falls over time as it does while a gear warms up"

    def hidden_in(self, motion: Motion) -> str | None:
        """Look like viscous friction in a period by itself, and in a recording far shorter than T0."""
        if motion.periodic:
            return None if motion.began else _HIDDEN
        duration = motion.samples * step(motion)
        if duration < _SHORT * self.setting["T0"]:
            return f"in {duration:.3g} s nothing drifts whose time constant is {self.setting['T0']:.3g} s"
        return None

    def smooth_terms(self, x: Signals, m: Mathematics, course: Course) -> Sequence[dict[int, Any]]:
        """Raise InputError: no periodic motion shows it better than another."""
        raise InputError(f"no excitation can be designed for {self.label}: {_HIDDEN}")

    def full_columns(self, motion: Motion, torques: Torques | None = None) -> Array:
        """Return dq exp(-t / T0), t from the recording's first sample; where periods are averaged, its mean."""
        t, span = np.arange(motion.samples) * step(motion), self.setting["T0"]
        level = float(np.mean(np.exp(-np.array(motion.began) / span))) if motion.began else 1.0
        out = np.zeros((motion.samples, self.robot.n, 1))
        out[:, self.joint, 0] = motion.dq[:, self.joint] * level * np.exp(-t / span)
        return out

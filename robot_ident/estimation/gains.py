"""Gains of drives with their covariance, and what they tell a user."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from robot_ident.signals.motion import Array


@dataclass(frozen=True)
class Gains:
    """Gains of drives that a robot's files don't know.

    joints [k]; values [k]: Nm/A (N/A), or over the first one's where no payload was known (`absolute` False); logarithm
    [k, k]: covariance of ln K. payload [k]: rms torque Nm that the payload makes at each; unloaded: those that it
    hardly loads; unknown: whose gain stays unknown, so that their results carry the unit A. exchanged: the recordings
    whose payloads would tell the gains, were they stated the other way round.
    """

    joints: tuple[str, ...]
    units: tuple[str, ...]
    values: Array
    logarithm: Array
    payload: Array
    unloaded: tuple[str, ...]
    unknown: tuple[str, ...]
    absolute: bool
    exchanged: str = ""

    @property
    def std(self) -> Array:
        """Standard deviation of each gain [k]."""
        return np.asarray(self.values * np.sqrt(np.diag(self.logarithm)))

    def to_dict(self) -> list[dict[str, Any]]:
        """Return the gains for `model.yaml`."""
        rows = zip(self.joints, self.units, self.values, self.std, self.payload, strict=True)
        return [
            {
                "joint": joint,
                "value": float(value),
                "std": float(std),
                "unit": unit if self.absolute and joint not in self.unknown else "A/A",
                "payload_rms": float(load),
                "loaded": joint not in self.unloaded,
            }
            for joint, unit, value, std, load in rows
        ]

    @property
    def notes(self) -> tuple[str, ...]:
        """What a user should know."""
        known = [k for k, joint in enumerate(self.joints) if not self.absolute or joint not in self.unknown]
        found = ", ".join(f"{self.joints[k]} {self.values[k]:.4g} +- {self.std[k]:.2g}" for k in known)
        if not self.absolute:
            return (
                f"drive gains over that of {self.joints[0]}: {found}; results carry the unit A: a recording with a"
                " known payload beside one without would tell Nm/A (its BAG.conditions.yaml states the payload)",
            )
        if not known:
            way = f"; exchanged between {self.exchanged} they would" if self.exchanged else ""
            return (
                f"the payloads that the conditions state tell no drive gain: results carry the unit A{way}; is each"
                " stated beside its own recording, its mass in kg?",
            )
        notes = [f"drive gains by the payload, {self.units[0]}: {found}"]
        if self.unloaded:
            notes.append(f"the payload does not load {', '.join(self.unloaded)}: gains there come by the links alone")
        if self.unknown:
            values = ", ".join(f"{v:.3g}" for j, v in zip(self.joints, self.values, strict=True) if j in self.unknown)
            notes.append(
                f"the gain of {', '.join(self.unknown)} stays unknown: results there carry the unit A, of a drive of"
                f" 1 {self.units[0]}, with {values} for it; give its torque_constant where a data sheet knows it"
            )
        return tuple(notes)

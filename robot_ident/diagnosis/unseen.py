"""Recordings that no fit sees, as evidence: how much less of their error a candidate leaves.

What only one of the motions shows (a stop that the others don't reach) can't be predicted from the others; on a
recording kept aside it can.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from robot_ident.diagnosis.evidence import Evidence, Trajectory, trajectory
from robot_ident.diagnosis.spectrum import white_lines
from robot_ident.effects import Effect, Torques
from robot_ident.recording.measurement import Measurement
from robot_ident.signals.motion import Array

if TYPE_CHECKING:
    from robot_ident.diagnosis.scan import Addition, BaseFit


@dataclass(frozen=True)
class Unseen:
    """Trajectories that no fit sees, with the columns `phi` [N, n, p] of a model on them and its torques along them."""

    trajectories: tuple[Trajectory, ...]
    rigid: tuple[Array, ...]
    phi: tuple[Array, ...]
    torques: tuple[Torques, ...]

    @classmethod
    def of(cls, measurements: Sequence[Measurement], evidence: Evidence) -> Unseen | None:
        """Return those of some measurements that tell their noise, seen by the model of an evidence; None without."""
        variances = [measured.averaged_variance for measured in measurements]
        known = [m for m, v in zip(measurements, variances, strict=True) if np.all(np.isfinite(v)) and np.all(v > 0)]
        if not known:
            return None
        trajectories = white_lines([trajectory(measured) for measured in known], evidence)
        rigid = tuple(evidence.structure.rigid_columns(t.motion) for t in trajectories)
        return cls(trajectories, rigid, (), ()).under(evidence)

    def under(self, evidence: Evidence) -> Unseen:
        """Return the same trajectories seen by the model of another evidence."""
        structure, values = evidence.structure, evidence.values
        pairs = list(zip(self.trajectories, self.rigid, strict=True))
        phi = tuple(t.weighed(structure.columns(t.motion, values, rigid)) for t, rigid in pairs)
        torques = tuple(structure.torques(t.motion, values, rigid) for t, rigid in pairs)
        return Unseen(self.trajectories, self.rigid, phi, torques)

    @property
    def dof(self) -> Array:
        """Independent rows [n]."""
        return np.asarray(np.sum([t.dof for t in self.trajectories], axis=0))

    def loss(self, fit: BaseFit) -> Array:
        """Return the squared error [n] of the model as it was fitted."""
        rest = (t.y - phi @ fit.values for t, phi in zip(self.trajectories, self.phi, strict=True))
        return np.asarray(np.sum([np.sum(r**2, axis=0) for r in rest], axis=0))

    def residuals(self, effect: Effect, addition: Addition) -> list[Array]:
        """Return the weighed residual [N, n] of every trajectory with a candidate as it was fitted."""
        out = []
        for t, phi, torques in zip(self.trajectories, self.phi, self.torques, strict=True):
            own = t.weighed(effect.columns(t.motion, torques)) @ addition.coefficients
            out.append(t.y - phi @ addition.values - own)
        return out

    def loss_with(self, effect: Effect, addition: Addition) -> Array:
        """Return the squared error [n] with a candidate as it was fitted."""
        return np.asarray(np.sum([np.sum(r**2, axis=0) for r in self.residuals(effect, addition)], axis=0))

"""What every format starts from: links, rotors and friction of a model, and the effects that are left over."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from robot_ident.export.full_inertias import FullInertias
from robot_ident.model.model import Model
from robot_ident.signals.motion import Array


@dataclass(frozen=True)
class Dynamics:
    """A model as rigid bodies with joint friction: tau = rnea(q, dq, ddq) + rotors ddq + damping dq + friction
    sign(dq).

    inertias: links and rotors. damping, friction [n]: Nm s/rad and Nm (N s/m and N). carried: labels of the effects
    that these hold. left: those that the formats of rigid bodies don't know.
    """

    model: Model
    inertias: FullInertias
    damping: Array
    friction: Array
    carried: tuple[str, ...]
    left: tuple[str, ...]

    @classmethod
    def of(cls, model: Model) -> Dynamics:
        """Return the dynamics of a model; InputError where no links can give its torque."""
        n = model.robot.n
        damping, friction = np.zeros(n), np.zeros(n)
        into = {"viscous": damping, "coulomb": friction}
        carried: list[str] = []
        left: list[str] = []
        for effect, own in model.structure.placed:
            if effect.name in into:
                into[effect.name][effect.joint] += model.linear[own.start]
            (carried if effect.name in into or effect.name == "rotor_inertia" else left).append(effect.label)
        return cls(model, FullInertias.of(model), damping, friction, tuple(carried), tuple(left))

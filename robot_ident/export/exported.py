"""What every format starts from, and what an export is: links, rotors and friction of a model, the effects that a
format carries, and what those that it leaves out cost in torque.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from robot_ident.export.inertias import FullInertias
from robot_ident.model.model import Model
from robot_ident.signals.motion import Array, Motion

CHOICE = "the torque tells combinations alone: masses and centres of single links are one choice of many"
"""What every format that holds single links has to say."""


@dataclass(frozen=True)
class Exported:
    """files: text by name within the folder, or under "" where the export is a single file. carried, left: effects as
    `name@joint` that the format holds and those that it can't. notes: one line each. rotors: inertia [kg m^2] on the
    joint side, by joint, of rotors that the format can't hold.
    """

    files: Mapping[str, str]
    carried: tuple[str, ...]
    left: tuple[str, ...]
    notes: tuple[str, ...]
    rotors: Mapping[str, float] = field(default_factory=dict)


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


def about_centre(ten: Array) -> tuple[float, Array, Array]:
    """Return mass [kg], centre of mass [3] m and inertia about it [3, 3] kg m^2: I_c = I - m (c'c 1 - c c')."""
    mass, centre = float(ten[0]), ten[1:4] / ten[0]
    xx, xy, yy, xz, yz, zz = ten[4:]
    about_origin = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return mass, centre, about_origin - mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))


def torque_of(model: Model, exported: Exported, motion: Motion) -> dict[str, Array]:
    """Return the rms torque [n] that a model loses along a motion by each effect and rotor that an export lacks."""
    columns, linked = model.structure.columns(motion, model.linear), model.structure.through_links
    links, scales = columns[:, :, linked] @ model.linear[linked], model.structure.scales
    out = {}
    for effect, own in model.structure.placed:
        if effect.label not in exported.left:
            continue
        torque = columns[:, :, own] @ model.linear[own]
        if effect.scales_links:  # it has no column: what it makes of the links' torque, a tauL - tauL
            torque = torque.copy()
            torque[:, effect.joint] = links[:, effect.joint] * (1.0 - 1.0 / scales[effect.joint])
        out[effect.label] = np.sqrt(np.mean(torque**2, axis=0))
    for joint, rotor in exported.rotors.items():
        torque = np.zeros_like(motion.ddq)
        torque[:, model.robot.joint_index(joint)] = rotor * motion.ddq[:, model.robot.joint_index(joint)]
        out[f"rotor_inertia@{joint}"] = np.sqrt(np.mean(torque**2, axis=0))
    return out

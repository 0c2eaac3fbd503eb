"""The ten parameters of every link that give a model's torque exactly: what formats of rigid bodies need.

Base parameters leave many standard ones open. Any links that give them give the same torque; those are taken whose
pseudo-inertia is positive definite and that are nearest to the URDF's.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from robot_ident.errors import InputError
from robot_ident.estimation.physical_consistency import (
    LEAST,
    NEAR,
    Nearest,
    inertial_scale,
    least_eigenvalues,
    pseudo_inertia_rows,
    rotors_of,
    solve,
    violations,
)
from robot_ident.model.model import Model
from robot_ident.model.structure import Structure
from robot_ident.signals.motion import Array, Mask

_ROTOR = 10.0  # cost of a rotor inertia of its link's unit, beside the squared distance to the URDF: kept where needed
_NOTHING = 1e-11  # of a link's unit: what the solver leaves of a zero


@dataclass(frozen=True)
class FullInertias:
    """Standard parameters [10 n] of the links in Pinocchio's order, and rotor inertias [n] kg m^2 beside them."""

    links: Array
    rotors: Array

    @classmethod
    def of(cls, model: Model) -> FullInertias:
        """Return inertias that give a model's rigid-body torque to rounding.

        Raises InputError where no links can have the model's parameters, with the inequality that they break.
        """
        structure = model.structure
        inertias, rotors = model.physical_inertias, model.physical_rotors
        if inertias is None or rotors is None:
            inertias, rotors = _possible(model)
        free = _free(structure)
        x = _exact(structure, np.concatenate([inertias, np.where(free, 0.0, np.maximum(rotors, 0.0))]), model.linear)
        if least_eigenvalues(x[: len(inertias)]).min() <= 0.0:
            raise InputError(_refusal(structure, model.linear))
        return cls(x[: len(inertias)], np.where(free, rotors, x[len(inertias) :]))

    def without_rotors(self, structure: Structure) -> FullInertias:
        """Return links that carry the rotor inertias themselves wherever some can, for formats that know no rotors.

        The torque stays the same: only what it does not tell is chosen anew.
        """
        free = _free(structure)
        start = np.concatenate([self.links, np.where(free, 0.0, self.rotors)])
        if not start[len(self.links) :].any():
            return self
        try:
            x = _least_rotors(structure, start)
        except InputError:
            return self
        links, rotors = x[: len(self.links)], x[len(self.links) :]
        if least_eigenvalues(links).min() <= 0.0:
            return self
        unit = inertial_scale(structure, self._base(structure))[len(links) :]
        gone = rotors < 1e-6 * unit
        moved = _exact(structure, np.concatenate([links, np.where(gone, 0.0, rotors)]), self._base(structure))
        if least_eigenvalues(moved[: len(links)]).min() <= 0.0:
            return self
        return FullInertias(moved[: len(links)], np.where(free, self.rotors, moved[len(links) :]))

    def _base(self, structure: Structure) -> Array:
        values: Array = structure.base.regrouping @ np.concatenate([self.links, self.rotors])
        return values


def _free(structure: Structure) -> Mask:
    """Return which rotors [n] merge with no base parameter: theirs is the effect `rotor_inertia`, or unknown."""
    n = structure.robot.n
    return np.asarray(~structure.base.regrouping[:, 10 * n :].any(axis=0))


def impossible(model: Model) -> tuple[float, str] | None:
    """Return by how many standard deviations no links can have a model's parameters, and why; None where some can."""
    _, _, squared = _nearest(model)
    return None if squared <= NEAR else (float(np.sqrt(squared)), _refusal(model.structure, model.linear))


def _nearest(model: Model) -> tuple[Array, Array, float]:
    """Return what gives the nearest possible parameters [11 n], these [p], and how far they are, squared."""
    structure = model.structure
    p = len(structure.parameters)
    program = Nearest.of(structure, model.linear, model.by_noise[:p, :p])
    x, values = program.to(model.linear)
    return x, values, program.squared_distance(values - model.linear)


def _possible(model: Model) -> tuple[Array, Array]:
    """Return standard inertias and rotors of a model that was not asked to be possible; InputError where it isn't."""
    structure = model.structure
    x, _, squared = _nearest(model)
    if squared > NEAR:
        raise InputError(_refusal(structure, model.linear))
    return x[: 10 * structure.robot.n], rotors_of(structure, x, model.linear)


def _refusal(structure: Structure, values: Array) -> str:
    broken = violations(structure, values)
    why = "; ".join(broken) if broken else "they lie on the border of what links can have"
    return (
        f"no links can have the parameters of this model ({why}): take the nearest possible ones"
        " (robot_ident identify --physical)"
    )


def _exact(structure: Structure, x: Array, values: Array) -> Array:
    """Return x [11 n] changed so little that it gives the base parameters to the last digit.

    A selected parameter regroups into itself alone; what its base parameter lacks is what it changes by.
    """
    x = x.copy()
    base = structure.base
    for _ in range(2):
        x[list(base.columns)] += values[: len(base.columns)] - base.regrouping @ x
    return x


def _least_rotors(structure: Structure, start: Array) -> Array:
    """Return x [11 n] with the base parameters of `start`, least rotor inertias, near the URDF otherwise.

    x = start + S N v, N spanning what no torque tells: pseudo-inertias positive definite, rotors not negative.
    """
    from scipy.linalg import null_space

    n = structure.robot.n
    scale = inertial_scale(structure, structure.base.regrouping @ start)
    open_ = null_space(structure.base.regrouping * scale)
    free = _free(structure)
    open_ = open_ @ null_space(open_[10 * n :][free]) if free.any() else open_
    here = start / scale
    urdf = np.concatenate([structure.robot.rigid.parameters, np.zeros(n)]) / scale
    quadratic = 2.0 * open_.T @ open_
    linear = 2.0 * open_.T @ (here - urdf) + _ROTOR * open_[10 * n :].sum(axis=0)
    # where a link is on the border of what is possible, a lower floor leaves the solver room around the start
    rows, rights = pseudo_inertia_rows(scale, open_[: 10 * n], here[: 10 * n], 0.1 * LEAST)
    a, b = np.vstack([-open_[10 * n :], rows]), np.concatenate([here[10 * n :], rights])
    v = solve(quadratic, linear, a, b, zero=0, positive=n, links=n)
    x = here + open_ @ v
    return np.asarray(scale * np.where(np.abs(x) < _NOTHING, 0.0, x))

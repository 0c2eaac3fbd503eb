"""Base parameters: the smallest set of combinations of inertial parameters that the torque depends on.

A deterministic numerical reduction (after Gautier, "Numerical calculation of the base inertial parameters", 1991):
columns of the standard regressor at fixed random states are taken in an order of preference, and a column that the
earlier ones span is regrouped into them: base = selected + K * regrouped.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from robot_ident.errors import InputError, did_you_mean
from robot_ident.robot.rigid_body import STANDARD, STANDARD_UNITS
from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Array, Motion, frozen_array

_DEPENDENT = 1e-9  # a column is spanned by others when less than this share of its norm remains


@dataclass(frozen=True)
class BaseParameters:
    """The base parameters of a rigid arm with its rotors.

    names, units [p]: shown names and units. columns [p]: indices of the selected standard parameters. regrouping [p,
    10 n + n]: base = regrouping @ [standard; armature]. rules [p]: that equation in words. free_rotors: joints whose
    rotor inertia merges with none.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    links: tuple[int, ...]
    columns: tuple[int, ...]
    regrouping: Array
    rules: tuple[str, ...]
    free_rotors: tuple[int, ...]

    def values(self, standard: Array, armature: Array) -> Array:
        """Return the base parameters [p] of standard parameters [10 n] and rotor inertias [n] (free rotors left
        out).
        """
        inertias: Array = self.regrouping @ np.concatenate([standard, armature])
        return inertias


def reduce_to_base(robot: Robot) -> BaseParameters:
    """Return the base parameters of a robot, with the names that its YAML gives them.

    Raises InputError when the YAML's names don't form a base.
    """
    rigid = robot.rigid
    motion = random_states(robot)
    in_front = [float(robot.side(joint) != "link") for joint in range(robot.n)]  # a link-side sensor feels no rotor
    rotors = np.einsum("kj,ij->kij", motion.ddq, np.diag(in_front))
    w = np.concatenate([rigid.regressor(motion), rotors], axis=2).reshape(-1, 11 * robot.n)
    wanted = _named(robot)
    order = wanted or _preference(robot)
    order = order + [k for k in _preference(robot) if k not in order]
    selected = _independent(w, order + list(range(10 * robot.n, 11 * robot.n)))
    free = tuple(k - 10 * robot.n for k in selected if k >= 10 * robot.n)
    base = [k for k in selected if k < 10 * robot.n]
    if wanted and base != wanted:
        _refuse(robot, wanted, base)
    base = base if wanted else sorted(base)
    regrouping = _regroup(w, base, [10 * robot.n + j for j in free])
    sources = (*rigid.names, *(f"rotor{j + 1}" for j in range(robot.n)))
    shown = tuple(robot.base_parameters) if wanted else tuple(rigid.names[k] for k in base)
    return BaseParameters(
        names=shown,
        units=tuple(STANDARD_UNITS[k % 10] for k in base),
        links=tuple(k // 10 for k in base),
        columns=tuple(base),
        regrouping=frozen_array(regrouping),
        rules=tuple(_rule(row, k, sources) for row, k in zip(regrouping, base, strict=True)),
        free_rotors=free,
    )


def random_states(robot: Robot) -> Motion:
    """Return random states of order one, the same for every call."""
    rng = np.random.default_rng(1997)
    samples = 20 * robot.n + 40
    draw = rng.uniform(-1.0, 1.0, (3, samples, robot.n))
    return Motion(np.pi * draw[0], 2.0 * draw[1], 4.0 * draw[2])


def _preference(robot: Robot) -> list[int]:
    """Return standard parameters in the order in which they are kept: mass, the first moment and one moment of
    inertia last.

    About a revolute axis u (with v, w across it) the second moment I_vv, the moment along u and the mass regroup into
    others (Khalil and Kleinfinger 1987).
    """
    inertia = {(0, 0): "Ixx", (0, 1): "Ixy", (1, 1): "Iyy", (0, 2): "Ixz", (1, 2): "Iyz", (2, 2): "Izz"}
    first: list[int] = []
    last: list[int] = []
    for link in range(robot.n):
        kind = robot.rigid.model.joints[1 + link].shortname()
        u = "XYZ".index(kind[-1]) if kind[-1] in "XYZ" else 2
        late = [] if robot.prismatic[link] else ["mxyz"[1 + u], inertia[((u + 2) % 3,) * 2], "m"]
        late = ["m" + word if word in "xyz" else word for word in late]
        first += [10 * link + STANDARD.index(word) for word in STANDARD if word not in late]
        last += [10 * link + STANDARD.index(word) for word in late]
    return first + last


def _named(robot: Robot) -> list[int]:
    names = robot.rigid.names
    for shown, standard in robot.base_parameters.items():
        if standard not in names:
            raise InputError(f"{robot.source}: base_parameters.{shown} = {standard!r}{did_you_mean(standard, names)}")
    return [names.index(standard) for standard in robot.base_parameters.values()]


def _refuse(robot: Robot, wanted: Sequence[int], base: Sequence[int]) -> None:
    names = robot.rigid.names
    extra = [names[k] for k in wanted if k not in base]
    lacking = [names[k] for k in base if k not in wanted]
    what = f"{extra[0]!r} depends on the ones before it" if extra else f"{lacking[0]!r} is missing"
    raise InputError(f"{robot.source}: base_parameters: {what}; leave the section out to have them found")


def _independent(w: Array, order: Sequence[int]) -> list[int]:
    """Return the columns of w, in order, that the ones before don't span (Gram-Schmidt, twice against rounding)."""
    kept: list[int] = []
    basis = np.empty((w.shape[0], 0))
    scale = np.linalg.norm(w, axis=0)
    for k in order:
        if scale[k] < 1e-10 * scale.max():
            continue
        rest = w[:, k] / scale[k]
        for _ in range(2):
            rest = rest - basis @ (basis.T @ rest)
        size = np.linalg.norm(rest)
        if size > _DEPENDENT:
            kept.append(k)
            basis = np.column_stack([basis, rest / size])
    return kept


def _regroup(w: Array, base: Sequence[int], free: Sequence[int]) -> Array:
    """Return [p, 11 n]: how each standard parameter and rotor enters the base parameters (free rotors have their own
    column).
    """
    selected = [*base, *free]
    k, *_ = np.linalg.lstsq(w[:, selected], w, rcond=None)
    k = k[: len(base)]
    k[np.abs(k) < 1e-8] = 0.0
    nearest = np.round(k, 9)
    return np.asarray(np.where(np.abs(k - nearest) < 1e-8, nearest, k))


def _rule(row: Array, own: int, sources: Sequence[str]) -> str:
    """Return `Izz2 + 0.2304 m3 + rotor2` for a row of the regrouping."""
    words = [sources[own]]
    for k in np.flatnonzero(row).tolist():
        if k != own:
            size = abs(row[k])
            factor = "" if abs(size - 1) < 1e-8 else f"{size:.6g} "
            words += ["+" if row[k] > 0 else "-", factor + sources[k]]
    return " ".join(words)

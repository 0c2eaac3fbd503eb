"""What the data cannot say: parameters left open, pairs that they can't tell apart, motions that excite too little."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from robot_ident.estimation.least_squares import scaled_eigen
from robot_ident.estimation.problem import Solution
from robot_ident.model.structure import Structure
from robot_ident.recording.measurement import Measurement
from robot_ident.signals.motion import Array, Motion

_OPEN = 0.5  # sigma over value, above which a parameter isn't known
_MATTERS = 0.05  # of a joint's torque: what an open parameter makes uncertain on motions within the limits
_UNCERTAIN = 0.25  # of a joint's torque, above which a model is not fit for other motions
_COLLINEAR = 0.95  # correlation of two estimates, above which only a combination is known
_CONDITION = 100.0  # of the normalised columns, above which excitation is called poor
_BLAME = 0.3  # share of a column in a weak direction
_STATES = 300  # random ones within the limits
_LISTED = 12  # names in a line
_REMEDY = "design a longer motion that is faster and wider (robot_ident design), or add recordings of others"
_FASTER = 2.0  # where a robot gives no limit: times what was recorded


@dataclass(frozen=True)
class Identifiability:
    """How far the data determine the parameters [p].

    influence [p]: rms torque that a sigma is worth on random states within the robot's
    limits, over the rms torque there, at the joint where it matters most. uncertainty [n]: that of the whole model.
    open: parameters that are not known and matter. pairs: nearly collinear estimates (name, name, correlation). weak:
    columns that make the condition number large.
    """

    influence: Array
    uncertainty: Array
    open: tuple[str, ...]
    pairs: tuple[tuple[str, str, float], ...]
    weak: tuple[str, ...]
    condition_number: float
    joints: tuple[str, ...]

    @property
    def warnings(self) -> tuple[str, ...]:
        """Why the model may fail on other motions, in plain words."""
        out = []
        if np.any(self.uncertainty > _UNCERTAIN):
            worst = int(np.argmax(self.uncertainty))
            size = self.uncertainty[worst]
            share = f"{100.0 * size:.2g} %" if size < 10.0 else "more than 1000 %"
            out.append(
                f"badly excited: on other motions within the robot's limits the torque of {self.joints[worst]} is"
                f" uncertain by {share}; {_REMEDY}"
            )
        if self.open:
            out.append(f"the data cannot give {_listed(self.open)}: sigma exceeds half of the value; {_REMEDY}")
        if self.condition_number > _CONDITION:
            out.append(
                f"condition number {self.condition_number:.3g} (good: below 30): the columns of {_listed(self.weak)}"
                " nearly depend on each other along this motion"
            )
        return tuple(out)

    @property
    def notes(self) -> tuple[str, ...]:
        """Which parameters are known together only, in plain words."""
        out = []
        for a, b, correlation in self.pairs:
            known = "difference" if correlation > 0 else "sum"
            out.append(
                f"{a} and {b} can hardly be told apart (correlation {correlation:+.3f}): only their {known}, each over"
                f" its sigma, is known; {_remedy_of(a, b)}"
            )
        return tuple(out)


def identifiability(found: Solution, measurements: Sequence[Measurement]) -> Identifiability:
    """Return how far some measurements determine the linear parameters of a solution."""
    structure = found.structure
    p = len(structure.parameters)
    values, covariance = found.values[:p], found.covariance[:p, :p]
    sigma = np.sqrt(np.diag(covariance))
    relative = sigma / np.maximum(np.abs(values), 1e-300)
    columns = _columns(structure, _states(structure, measurements))
    size = np.sqrt(np.mean((columns @ values) ** 2, axis=0))
    size = np.maximum(size, 1e-3 * max(float(size.max()), 1e-12))
    # along the recordings what single states don't tell
    past, equations = structure.places_of(lambda effect: effect.uses_torque or not effect.symbolic), found.equations
    recorded = [past * _rms(equations.phi[equations.joint == joint]) for joint in range(structure.robot.n)]
    influence = np.max(np.maximum(_rms(columns), recorded) * sigma / size[:, None], axis=0)
    spread = np.einsum("kjp,pq,kjq->j", columns, covariance, columns, optimize=True) / len(columns)
    unknown = np.flatnonzero((relative > _OPEN) & (influence > _MATTERS))
    return Identifiability(
        influence=influence,
        uncertainty=np.sqrt(np.maximum(spread, 0.0)) / size,
        open=tuple(structure.names[k] for k in unknown[np.argsort(-influence[unknown])]),
        pairs=_pairs(structure.names, covariance, sigma),
        weak=_weak(found),
        condition_number=found.condition_number,
        joints=structure.robot.joints,
    )


def _columns(structure: Structure, states: Motion) -> Array:
    """Return the columns [K, n, p] at single states; zero for effects that depend on the past or on torque."""
    out = np.zeros((states.samples, structure.robot.n, len(structure.parameters)))
    out[:, :, : len(structure.base.columns)] = structure.reported(structure.rigid_columns(states))
    for effect, own in structure.placed:
        if effect.symbolic and not effect.uses_torque:
            out[:, :, own] = structure.columns_of(effect, states)
    return out


def _rms(columns: Array) -> Array:
    return np.asarray(np.sqrt(np.mean(columns**2, axis=0)))


def _states(structure: Structure, measurements: Sequence[Measurement]) -> Motion:
    """Return random states within the robot's limits, or twice what was recorded where it has none; always the same."""
    limits, n = structure.robot.limits, structure.robot.n
    q = np.concatenate([m.motion.q for m in measurements])
    # away from the ends, where the derivatives of what doesn't repeat mean little
    ends = [0 if m.motion.periodic else m.motion.samples // 20 for m in measurements]
    inside = [m.motion[end : m.motion.samples - end] for m, end in zip(measurements, ends, strict=True)]
    top = [
        _FASTER * np.max([np.abs(part).max(axis=0) for part in parts], axis=0)
        for parts in ([one.dq for one in inside], [one.ddq for one in inside])
    ]
    lower = np.where(np.isfinite(limits.lower), limits.lower, q.min(axis=0))
    upper = np.where(np.isfinite(limits.upper), limits.upper, q.max(axis=0))
    speed = np.minimum(limits.velocity, top[0])
    acceleration = np.minimum(limits.acceleration, top[1])
    draw = np.random.default_rng(1997).uniform(-1.0, 1.0, (3, _STATES, n))
    return Motion(0.5 * (lower + upper) + 0.5 * (upper - lower) * draw[0], speed * draw[1], acceleration * draw[2])


def _pairs(names: Sequence[str], covariance: Array, sigma: Array) -> tuple[tuple[str, str, float], ...]:
    """Return the pairs of estimates that are correlated by more than .95, the strongest five."""
    scale = np.where(sigma > 0, sigma, 1.0)
    correlation = np.triu(covariance / np.outer(scale, scale), 1)
    rows, columns = np.nonzero(np.abs(correlation) > _COLLINEAR)
    order = np.argsort(-np.abs(correlation[rows, columns]))[:5]
    return tuple((names[rows[k]], names[columns[k]], float(correlation[rows[k], columns[k]])) for k in order)


def _weak(found: Solution) -> tuple[str, ...]:
    """Return the columns that take part in directions whose singular value is under a hundredth of the largest."""
    scaled = found.equations.phi / np.sqrt(found.variance)[:, None]
    _, size, vectors = scaled_eigen(scaled.T @ scaled)
    share = np.abs(vectors[:, size < size[-1] / _CONDITION**2]).max(axis=1, initial=0.0)
    return tuple(found.structure.names[k] for k in np.argsort(-share) if share[k] > _BLAME)


def _remedy_of(a: str, b: str) -> str:
    both = f"{a} {b}"
    if "coulomb" in both and "viscous" in both:
        return "vary the speed of the joint: slow and fast passes"
    if "torque_offset" in both or "spring" in both or "cable" in both:
        return "use the whole range of the joint"
    return "move the joints out of phase and through other postures"


def _listed(names: Sequence[str]) -> str:
    more = f" and {len(names) - _LISTED} more" if len(names) > _LISTED else ""
    return ", ".join(names[:_LISTED]) + more

"""What estimators share: the equations of some measurements with their noise, and what a solution amounts to."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace

import numpy as np

from robot_ident.effects import Effect
from robot_ident.effects.torque_scale import SPREAD, TorqueScale
from robot_ident.estimation.equations import Compared, Equations, stack
from robot_ident.estimation.least_squares import Factor, RowNoise, at_least, factor, row_noise, sandwich
from robot_ident.model.structure import Structure
from robot_ident.recording.measurement import Measurement
from robot_ident.regression.block_jackknife import block_jackknife, half_seconds
from robot_ident.signals.motion import Array

_TORQUE_ROUNDS = 4  # of the fixed point: load friction of 10 % leaves 1e-4 of itself after four
_CHANCE = 1e-3  # that noise alone leaves as much on any joint
_WORTH_A_WORD = 0.05  # probability of another form
STEP = 1e-3  # of the range between an inner parameter's bounds, for derivatives


@dataclass(frozen=True)
class OtherForm:
    """An effect in another of its forms, which only values of a grid tell apart.

    words: these values. more: chi-square that it leaves more, in units of what is left of the effect's joint, at least
    of noise. values [p + r], covariance: of all parameters with it, the effect's own inner ones those of that form.
    """

    effect: Effect
    words: str
    more: float
    values: Array
    covariance: Array


@dataclass(frozen=True)
class Solution:
    """Parameters [p + r] with covariance, the equations at the solution, and their noise variance [R].

    chi_square: weighted squared error, with dof degrees of freedom; nan where the noise is not known independently.
    other_forms: of its effects. over_blocks [p + r, p + r]: covariance by leaving out half a second at a time,
    zero where nothing is missing. excess [n]: how many times their noise the residuals of joints are in variance, 1
    where that is chance, nan where noise is not known.
    """

    structure: Structure
    values: Array
    covariance: Array
    equations: Equations
    variance: Array
    condition_number: float
    notes: tuple[str, ...]
    over_blocks: Array
    excess: Array
    chi_square: float = float("nan")
    dof: float = float("nan")
    other_forms: tuple[OtherForm, ...] = ()

    @property
    def misfits(self) -> bool:
        """Whether more than noise is left, or noise is not known."""
        return not np.all(self.excess == 1.0)

    def wider(self, further: Array) -> Solution:
        """Return the solution with a covariance [p, p] more of its linear parameters."""
        covariance, p = np.array(self.covariance), len(further)
        covariance[:p, :p] += further
        return replace(self, covariance=covariance)

    def whatever_is_missing(self) -> Solution:
        """Return the solution with a covariance that counts what the model lacks, where it leaves more than noise or
        noise is not known: in no direction smaller than noise makes it, nor than half a second left out at a time.
        """
        if not self.misfits:
            return self
        covariance, known = np.array(self.covariance), np.diag(self.covariance) > 0.0
        own = np.ix_(known, known)
        covariance[own] = at_least(self.over_blocks[own], covariance[own])
        return replace(self, covariance=covariance)

    def whichever_form(self) -> Solution:
        """Return the solution with a covariance that holds whichever form an effect has, and notes on forms that fit
        nearly as well: sum_k p_k (C_k + (t_k - t) (t_k - t)'), C_k the covariance and t_k the linear parameters with
        form k, t those with the one that fits best, p_k ~ exp(-chi-square_k / 2) how probable it is.
        """
        p, notes = len(self.structure.parameters), []
        chances = np.exp(-0.5 * np.array([form.more for form in self.other_forms]))
        total = 1.0 + chances.sum()
        covariance = self.covariance / total
        for form, chance in zip(self.other_forms, chances / total, strict=True):
            moved = form.values[:p] - self.values[:p]
            covariance = covariance + chance * form.covariance
            covariance[:p, :p] += chance * np.outer(moved, moved)
            if chance > _WORTH_A_WORD:
                far = np.abs(moved) / np.sqrt(np.diag(self.covariance)[:p])
                told = ", ".join(
                    f"{self.structure.names[k]} {form.values[k]:.3g} instead of {self.values[k]:.3g}"
                    for k in np.argsort(-far)[:3]
                    if far[k] > 1.0
                )
                notes.append(
                    f"{form.effect.label} fits nearly as well with {form.words} (chi-square {form.more:.2g} more)"
                    + (f": {told}; the standard deviations take that in" if told else "")
                )
        return replace(self, covariance=covariance, notes=(*self.notes, *notes))


class Problem:
    """The measurements with what does not change while parameters are searched: columns and noise."""

    def __init__(self, measurements: Sequence[Measurement], structure: Structure, *, weighted: bool = True) -> None:
        """Compute the links' columns once; `weighted` by the noise, or every row alike."""
        self.measurements = measurements
        self.names = structure.names
        self.source = ", ".join(measured.source for measured in measurements)
        self.weighted = weighted
        self.compared = [Compared(measured, structure) for measured in measurements]
        equations = self.equations(structure, None)
        self.variance, self.notes = _variances(equations, structure, measurements, self.source)
        self.noise: RowNoise = row_noise(measurements, equations, self.variance)

    @property
    def unknown(self) -> tuple[int, ...]:
        """Measurements whose noise no periods tell."""
        return tuple(k for k, m in enumerate(self.measurements) if not np.all(np.isfinite(m.averaged_variance)))

    def moved(self, measurements: Sequence[Measurement], structure: Structure) -> Problem:
        """Return the same problem, same rows and noise, along other motions."""
        other = copy(self)
        other.measurements = measurements
        other.compared = [Compared(measured, structure) for measured in measurements]
        return other

    def weighed_anew(self, structure: Structure) -> Problem:
        """Return the problem whose unknown noise is what a structure at these inner parameters leaves."""
        if not self.unknown:
            return self
        equations = self.equations(structure, None)
        return self.weighted_by(equations, *_variances(equations, structure, self.measurements, self.source))

    def weighted_by(self, equations: Equations, variance: Array, notes: tuple[str, ...]) -> Problem:
        """Return the problem whose rows have other variances [R], with the notes that say where they come from."""
        other = copy(self)
        other.variance, other.notes = variance, notes
        other.noise = row_noise(self.measurements, equations, variance)
        return other

    def beside(self, values: Array, equations: Equations) -> Problem | None:
        """Return the problem that doesn't weigh by the colour of noise where linear parameters [p] leave far more than
        noise; None where there is none of that.
        """
        noise = self.noise.beside(equations.torque - equations.phi @ values, equations)
        if not self.weighted or noise.weighs or not self.noise.weighs:
            return None
        other = copy(self)
        other.noise = noise
        loud = {int(equations.block[b.rows[0]]) for b in noise.blocks if not b.weighs}
        which = ", ".join(self.measurements[block].source for block in sorted(loud))
        note = f"{which}: the residual is far more than noise; rows are weighted by its variance, not by its colour"
        other.notes = (*self.notes, note)
        return other

    def equations(self, structure: Structure, values: Array | None) -> Equations:
        """Return the equations for given inner parameters and torques."""
        return stack(self.measurements, structure, values, self.compared)

    def columns_of(self, structure: Structure, effects: Sequence[Effect]) -> Array:
        """Return the columns [R, k] of some effects that don't depend on torque, in the rows of `equations`."""
        return np.concatenate([compared.rows_of(structure, effects) for compared in self.compared])

    def linear(self, structure: Structure) -> tuple[Array, Array, Equations]:
        """Return theta [p] for given inner parameters, (F' W F)^-1 and the equations that it solves; `covariance` says
        what the noise makes of it.
        """
        near = self._without_torque_effects(structure) if structure.uses_torque else None
        for _ in range(_TORQUE_ROUNDS if structure.uses_torque else 1):
            equations = self.equations(structure, near)
            factored = self.factored(equations.phi, self.names)
            values = near = factored.solve(self.right(equations.torque))
        return values, factored.inverse_information(), equations

    def factored(self, phi: Array, names: Sequence[str]) -> Factor:
        """Factorise the weighted columns [R, p]."""
        return factor(self.right(phi), names, self.source)

    def right(self, torque: Array) -> Array:
        """Return rows [R, ...] as the factor of the columns takes them."""
        return self.noise.weigh(torque) if self.weighted else torque

    def covariance(self, equations: Equations, jacobian: Array, residual: Array, names: Sequence[str]) -> Array:
        """Return the covariance [p, p] of parameters whose derivatives of torque are `jacobian` [R, p].

        (F' S^-1 F)^-1 (eq. 9) where the noise is known and its inverse weighs; else the sandwich of whatever weighs.
        """
        bread = self.factored(jacobian, names).inverse_information()
        if self.weighted and self.noise.weighs and not self.unknown:
            return bread
        weighed = self.noise.precision(jacobian) if self.weighted else jacobian
        return sandwich(bread, weighed, residual, equations, self.noise, self.unknown)

    def over_blocks(self, equations: Equations, jacobian: Array, residual: Array, before: Array | None = None) -> Array:
        """Return the covariance [p, p] of the same parameters by leaving out half a second of a motion at a time;
        before [p, p]: information before data.
        """
        weighed = self.noise.precision(jacobian) if self.weighted else jacobian
        blocks = half_seconds(self.measurements, equations.block, equations.sample)
        return block_jackknife(jacobian, weighed, residual, blocks, before)

    def whatever_is_missing(
        self, equations: Equations, jacobian: Array, residual: Array, before: Array, spread: Array
    ) -> Array:
        """Return a covariance [p, p] that counts what is missing where more than noise is left [R]; spread: by noise
        and by what is known before data, information [p, p].
        """
        if np.all(self.excess(equations, residual) == 1.0):
            return spread
        left_out = self.over_blocks(equations, jacobian, residual, before)
        return at_least(left_out + spread @ before @ spread, spread)

    def excess(self, equations: Equations, residual: Array) -> Array:
        """Return how many times their noise the residuals [R] of joints are in variance [n], 1 where noise makes as
        much once in a thousand times, nan where it is not known (F test of rows whitened).
        """
        joints = len(self.measurements[0].joints)
        if self.unknown:
            return np.full(joints, np.nan)
        power = equations.independent * self.noise.whiten(residual) ** 2
        rows = np.maximum(np.bincount(equations.joint, equations.independent, joints), 1.0)
        return self.beyond_chance(np.bincount(equations.joint, power, joints) / rows, rows)

    def beyond_chance(self, ratio: Array, rows: Array) -> Array:
        """Return ratios [k] of the variance that independent rows [k] leave to that of noise, 1 where they are chance
        (F test); of so many at once.
        """
        from scipy.special import fdtrc

        chance = fdtrc(rows, sum(measured.variance_dof for measured in self.measurements), ratio)
        return np.asarray(np.where(chance < _CHANCE / len(ratio), ratio, 1.0))

    def _without_torque_effects(self, structure: Structure) -> Array:
        """Return a first theta [p] from the columns that don't depend on torque, zero elsewhere."""
        equations = self.equations(structure, None)
        plain = ~structure.places_of(lambda effect: effect.uses_torque)
        values = np.zeros(len(self.names))
        names = [name for name, kept in zip(self.names, plain, strict=True) if kept]
        values[plain] = self.factored(equations.phi[:, plain], names).solve(self.right(equations.torque))
        return values


def solution(problem: Problem, structure: Structure, values: Array, equations: Equations) -> Solution:
    """Return what linear parameters [p] and a structure's inner ones amount to."""
    residual = equations.torque - equations.phi @ values
    jacobian, place = with_inner(problem, structure, values, equations)
    parameters = (*structure.parameters, *structure.inner)
    covariance, over_blocks = np.zeros((2, len(parameters), len(parameters)))
    names = [parameters[k].name for k in place]
    covariance[np.ix_(place, place)] = problem.covariance(equations, jacobian, residual, names)
    excess = problem.excess(equations, residual)
    if np.any(excess != 1.0):
        over_blocks[np.ix_(place, place)] = problem.over_blocks(equations, jacobian, residual)
    for k, scale in enumerate(structure.settings, len(structure.parameters)):
        if parameters[k].effect == TorqueScale.name:  # known before data: (C^-1 + 1 / (a SPREAD)^2)^-1
            for one in (covariance, over_blocks):
                one -= np.outer(one[:, k], one[:, k]) / (one[k, k] + (SPREAD * scale) ** 2)
    known = not problem.unknown and not problem.noise.bands
    independent = equations.independent
    weighed = factor(equations.phi / np.sqrt(problem.variance)[:, None], structure.names, problem.source)
    return Solution(
        structure=structure,
        values=np.concatenate([values, structure.settings]),
        covariance=covariance,
        equations=equations,
        variance=problem.variance,
        condition_number=weighed.condition_number,
        notes=problem.notes,
        chi_square=float(np.sum(independent * problem.noise.whiten(residual) ** 2)) if known else float("nan"),
        dof=float(np.sum(independent) - len(place)) if known else float("nan"),
        over_blocks=over_blocks,
        excess=excess,
    )


def inner_bounds(structure: Structure) -> tuple[Array, Array, np.ndarray]:
    """Return lower and upper bounds [r] of the inner parameters and which of them are continuous."""
    inner = [inner for effect in structure.effects for inner in effect.inner]
    lower, upper = (np.array([getattr(i, side) for i in inner]) for side in ("lower", "upper"))
    return lower, upper, np.array([i.continuous for i in inner], dtype=bool)


def with_inner(problem: Problem, structure: Structure, values: Array, equations: Equations) -> tuple[Array, np.ndarray]:
    """Return the derivatives of torque [R, p + free] by linear and free inner parameters, and their places among all.

    Inner parameters by central differences within their bounds; those that only take values of a grid have none.
    """
    p = equations.phi.shape[1]
    if not structure.inner:
        return equations.phi, np.arange(p)
    lower, upper, free = inner_bounds(structure)
    settings = structure.settings
    columns = [equations.phi]
    linked = structure.through_links
    links = equations.phi[:, linked] @ values[linked]
    for k in np.flatnonzero(free):
        if structure.inner[k].effect == TorqueScale.name:
            joint = structure.robot.joint_index(structure.inner[k].joint or "")
            columns.append(np.where(equations.joint == joint, links / settings[k], 0.0)[:, None])
            continue
        ends = np.clip(settings[k] + STEP * (upper[k] - lower[k]) * np.array([-1.0, 1.0]), lower[k], upper[k])
        moved = [np.where(np.arange(len(settings)) == k, end, settings) for end in ends]
        before, after = (problem.equations(structure.with_settings(one), values).phi @ values for one in moved)
        columns.append(((after - before) / (ends[1] - ends[0]))[:, None])
    return np.hstack(columns), np.concatenate([np.arange(p), p + np.flatnonzero(free)])


def beside_wls(
    estimator: str, values: Array, start: Solution, covariance: Array, least: float, words: tuple[str, str]
) -> str:
    """Return in a line whether and where an estimate differs from weighted least squares by more than `least` sigmas,
    and with what words for either.
    """
    names = [parameter.name for parameter in (*start.structure.parameters, *start.structure.inner)]
    sigma = np.sqrt(np.diag(covariance))
    shift = np.abs(values - start.values) / np.where(sigma > 0, sigma, np.inf)
    moved = [f"{names[k]} {shift[k]:.2g}" for k in np.argsort(-shift)[:5] if shift[k] > least]
    if moved:
        return f"{estimator} differs from wls, in standard deviations: {', '.join(moved)}{words[0]}"
    return f"{estimator} agrees with wls within {shift.max():.2g} standard deviations{words[1]}"


def _variances(
    equations: Equations, structure: Structure, measurements: Sequence[Measurement], source: str
) -> tuple[Array, tuple[str, ...]]:
    """Return the noise variance of every row; from the residual of ordinary least squares where no periods tell it."""
    unknown = ~np.isfinite(equations.variance) | (equations.variance <= 0)
    if not unknown.any():
        return equations.variance, ()
    silent = np.linalg.norm(equations.phi, axis=0) == 0.0
    silent[: len(structure.base.columns)] = False  # of effects that depend on a torque not known yet
    names = [name for name, drop in zip(structure.names, silent, strict=True) if not drop]
    phi = equations.phi[:, ~silent]
    residual = equations.torque - phi @ factor(phi, names, source).solve(equations.torque)
    variance = equations.variance.copy()
    share = equations.rows / (equations.rows - len(names))
    for block in np.unique(equations.block[unknown]):
        for rows in (own & unknown for own in equations.of_joints(block)):
            if rows.any():
                variance[rows] = max(float(np.mean(residual[rows] ** 2)) * share, 1e-12)
    which = ", ".join(measurements[block].source for block in np.unique(equations.block[unknown]))
    return variance, (
        f"{which}: noise unknown without periods; rows weighted by the residual of ordinary least squares",
    )

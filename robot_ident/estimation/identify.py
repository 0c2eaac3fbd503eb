"""Identification: from recordings to a model, and from a model to one with further effects, drives' gains found anew
where it has some, for what is missing from a model gains make up for.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace

import numpy as np

from robot_ident.effects import Effect
from robot_ident.effects.torque_scale import TorqueScale
from robot_ident.errors import InputError, did_you_mean
from robot_ident.estimation.base_model import Choice, choose_base, torque_scale_notes
from robot_ident.estimation.declaration import unit_notes
from robot_ident.estimation.drive_gains import Gains, robot_without, spread_by_gains, with_known_gains
from robot_ident.estimation.driving import driven, implausible_notes, negative_notes
from robot_ident.estimation.effort_checks import contradictions, taken_as_declared
from robot_ident.estimation.equations import apart, stack
from robot_ident.estimation.identifiability import identifiability
from robot_ident.estimation.maximum_likelihood import position_notes
from robot_ident.estimation.payload import solve_carrying
from robot_ident.estimation.prediction import processing_of
from robot_ident.estimation.repeatability import by_day, drift_notes, per_period
from robot_ident.estimation.solve import ESTIMATORS
from robot_ident.model.model import Model, NoiseLevel
from robot_ident.model.structure import Structure
from robot_ident.recording.checks import refuse_copies, refuse_same_rows
from robot_ident.recording.measurement import Measurement, Processing, time_scale_notes
from robot_ident.recording.process import process
from robot_ident.recording.recording import Recording
from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Array


def identify(
    recordings: Sequence[Recording],
    robot: Robot,
    *,
    effects: Sequence[str] = (),
    estimator: str = "wls",
    processing: Processing | None = None,
    physical: bool = False,
    as_declared: bool = False,
) -> Model:
    """Estimate a robot's parameters from one or several recordings.

    How recordings are processed, and whether offsets and rotor inertias belong to the model, is chosen by what predicts
    motion left out; what `processing` states, and all where the robot's base is declared, stays as it is. as_declared:
    go on where the data contradict what the robot declares of its efforts. Raises InputError where they do
    otherwise, on recordings that can't be used or are copies of each other, unknown effects or estimators, and motions
    that don't excite a parameter.
    """
    processing = processing or Processing()
    structure = Structure.build(robot, effects)
    refuse_same_rows(recordings)
    measurements = [process(recording, robot, processing) for recording in recordings]
    refuse_copies(measurements)
    otherwise = ", or go on with as_declared=True"
    doubts = contradictions(measurements, robot, as_declared=as_declared, otherwise=otherwise)
    chosen = with_base(recordings, measurements, structure, processing)
    return chosen.model(estimator=estimator, physical=physical, notes=doubts)


@dataclass(frozen=True)
class Chosen:
    """Recordings processed as was chosen, the base model that goes with it, and the gains of the drives."""

    measurements: Sequence[Measurement]
    structure: Structure
    gains: Gains | None
    choice: Choice

    def model(self, *, estimator: str, physical: bool, notes: Sequence[str]) -> Model:
        """Return the model, these notes before its own."""
        made = estimate(
            self.measurements,
            self.structure,
            estimator=estimator,
            processing=self.choice.processing,
            physical=physical,
            gains=self.gains,
            before=(*notes, *self.choice.notes),
        )
        made = with_scale_spread(replace(made, base=self.choice.to_dict()))
        scales = {
            parameter.joint or "": (float(value), float(std))
            for parameter, value, std in zip(made.parameters, made.values, made.std, strict=True)
            if parameter.effect == TorqueScale.name
        }
        told = [*torque_scale_notes(self.choice, scales), *_lagging(made, self.choice.effects)]
        return replace(made, notes=made.leading((made.filters_doubt, *made.notes, *told)))


def with_scale_spread(model: Model) -> Model:
    """Return a model whose torque scales have at least the sigma of their spread over the pieces of its base."""
    spread = (model.base or {}).get("scale_spread")
    if spread is None:
        return model
    scales = [k for k, one in enumerate(model.parameters) if one.effect == TorqueScale.name]
    least = np.array([spread[model.robot.joint_index(model.parameters[k].joint or "")] for k in scales])

    def wider(covariance: Array) -> Array:
        std, factor = np.sqrt(np.diag(covariance)[scales]), np.ones(len(covariance))
        factor[scales] = np.where(std > 0.0, np.maximum(1.0, least / np.maximum(std, 1e-300)), 1.0)
        return np.asarray(covariance * factor * factor[:, None])

    noise = None if model.noise_covariance is None else wider(model.noise_covariance)
    return replace(model, covariance=wider(model.covariance), noise_covariance=noise)


def _lagging(model: Model, chosen: Sequence[str]) -> list[str]:
    """Return a line on rotor inertias that prediction asked for and that come out below zero, beyond two sigma."""
    below = [
        parameter.joint or ""
        for parameter, value, std in zip(model.parameters, model.values, model.std, strict=True)
        if parameter.name in chosen and parameter.effect == "rotor_inertia" and value < -2.0 * std
    ]
    if not below:
        return []
    return [
        f"the rotor inertia of {', '.join(below)} is below zero: it predicts, but is none; a low pass or a delay in the"
        " effort, or an elastic gear, looks alike"
    ]


def with_base(
    recordings: Sequence[Recording], measurements: Sequence[Measurement], structure: Structure, processing: Processing
) -> Chosen:
    """Return what a model is estimated from: gains of drives first, then the base model that predicts best with them.

    measurements: the recordings as `processing` has them; they stay where nothing else predicts better.
    """
    robot = structure.robot
    known, with_gains, gains = with_known_gains(recordings, measurements, structure, processing)
    further = [effect.label for effect in structure.added]
    choice = choose_base(recordings, replace(with_gains.robot, base=robot.base), further, processing)
    taken = replace(choice.processing, band=processing.band, band_derivative=processing.band_derivative)
    if taken == processing and not choice.effects:
        return Chosen(known, with_gains, gains, choice)
    if taken != processing:
        measurements = [process(recording, robot, choice.processing) for recording in recordings]
    structure = structure.with_further([label for label in choice.effects if structure.lacks(label)])
    return Chosen(*with_known_gains(recordings, measurements, structure, choice.processing), choice)


def estimate(
    measurements: Sequence[Measurement],
    structure: Structure,
    *,
    estimator: str = "wls",
    processing: Processing | None = None,
    physical: bool = False,
    gains: Gains | None = None,
    before: Sequence[str] = (),
) -> Model:
    """Return the model of some measurements: eq. (7), (10) or the minimum of (4), with its covariance.

    physical: take the nearest parameters that a real arm can have. gains: those of the drives that the same recordings
    told, whose uncertainty the covariance takes in. before: notes that come before its own, after what may fail on
    other motions. Payloads that conditions leave open are found with the arm, and the model is that of the arm alone.
    """
    if estimator not in ESTIMATORS:
        raise InputError(f"unknown estimator {estimator!r}{did_you_mean(estimator, ESTIMATORS)}")
    if not measurements:
        raise InputError("no recording was given")
    if physical and structure.robot.ampere_joints:
        raise InputError(
            f"robot {structure.robot.name}: without drive gains no inertia is known in kg m^2, and none can be physical"
        )
    solved = solve_carrying(measurements, structure, estimator)
    solved = replace(solved, solution=solved.solution.whichever_form())
    measurements, excited, payloads = solved.measurements, solved.solution, solved.payloads
    found = excited.whatever_is_missing()
    taken = apart(measurements, structure.effects)
    # where a trend is part of the model, no period by itself tells it from the level
    periods = per_period(measurements, found, estimator) if taken is measurements else ()
    if gains is not None:
        count = len(structure.parameters)
        spread = spread_by_gains(gains, solved, found.structure, found.values[:count])
        excited, found = (one.wider(spread[:count, :count]) for one in (excited, found))
        payloads = solved.spread(spread[count:, count:])
    notes = [
        *structure.notes,
        *structure.rotors_left_out,
        *(f"{m.source}: {note}" for m in measurements for note in m.notes),
        *found.notes,
    ]
    notes += [note for payload in payloads for note in payload.notes]
    notes += () if gains is None else gains.notes
    notes = [*driven(found.structure, measurements, found.values, found.covariance).notes, *notes]
    notes += negative_notes(found.structure, found.values, np.sqrt(np.diag(found.covariance)))
    notes += drift_notes(periods, structure.names)
    notes += [] if structure.robot.ampere_joints else unit_notes(measurements, found)
    days = by_day(measurements, found)
    notes += days.notes(structure.names)
    determined = identifiability(excited, measurements)
    notes += determined.notes
    notes += time_scale_notes(measurements)
    consistent = None
    if physical:
        from robot_ident.estimation.physical_consistency import nearest_physical

        consistent = nearest_physical(found)
        found = consistent.solution
        notes += consistent.notes
    linear = found.values[: len(structure.parameters)]
    equations = found.equations if taken is measurements else stack(measurements, found.structure, linear)
    residual = equations.fits(equations.torque - equations.phi @ linear, structure.robot.joints)
    implausible = implausible_notes(found.structure, equations, linear, np.sqrt(np.diag(found.covariance)))
    notes = [*determined.warnings, *before, *implausible, *notes]
    _, logdet = np.linalg.slogdet(excited.covariance[: len(linear), : len(linear)])
    return Model(
        structure=found.structure,
        values=found.values,
        covariance=found.covariance,
        estimator=estimator,
        noise=_noise(measurements),
        residual=residual,
        condition_number=found.condition_number,
        log10_det_covariance=float(logdet / np.log(10.0)),
        processing=asdict(processing or Processing()),
        notes=(
            *notes,
            *_misfit_notes(excited.excess, structure.robot.joints),
            *position_notes(measurements, found, estimator),
        ),
        per_period=tuple(one.to_dict(structure.names) for one in periods),
        chi_square=found.chi_square if np.isfinite(found.chi_square) else None,
        dof=found.dof if np.isfinite(found.dof) else None,
        physical=None if consistent is None else consistent.to_dict(),
        recordings=tuple(measured.facts() for measured in measurements),
        gains=None if gains is None else tuple(gains.to_dict()),
        days=days.to_dict(structure.names),
        payloads=tuple(payload.to_dict() for payload in payloads),
        noise_covariance=excited.covariance if excited.misfits else None,
    )


def _misfit_notes(excess: Array, joints: Sequence[str]) -> list[str]:
    """Return a line that names the joints whose residual is more than their noise; excess [n]: of `Solution`."""
    beyond = [f"{joint} {ratio:.3g}" for joint, ratio in zip(joints, excess, strict=True) if ratio > 1.0]
    if not beyond:
        return []
    return [
        f"the residual exceeds the noise, in variance: {', '.join(beyond)} times; the standard deviations count what"
        " the model lacks, by leaving out half a second at a time (robot_ident compare shows where it fails)"
    ]


def _noise(measurements: Sequence[Measurement]) -> NoiseLevel:
    """Return the noise of one sample, pooled over recordings by their degrees of freedom."""
    periodic = [measured for measured in measurements if measured.variance_dof > 0]
    if not periodic:
        unknown, first = (None,) * len(measurements[0].joints), measurements[0]
        return NoiseLevel(unknown, unknown, first.periods, first.samples_per_period)
    weights, first = [measured.variance_dof for measured in periodic], periodic[0]
    torque = np.average([measured.torque_variance for measured in periodic], axis=0, weights=weights)
    position = np.average([measured.position_variance for measured in periodic], axis=0, weights=weights)
    return NoiseLevel(tuple(torque.tolist()), tuple(position.tolist()), first.periods, first.samples_per_period)


def extend(model: Model, measurements: Sequence[Measurement], effects: Sequence[Effect]) -> list[Model]:
    """Return the model refitted as it is, then with one effect more each time."""
    steps = []
    for count in range(len(effects) + 1):
        structure = model.structure.with_further(effects[:count])
        fitted = estimate(measurements, structure, estimator=model.estimator, processing=processing_of(model))
        steps.append(_of(model, fitted, [effect.label for effect in effects[:count]]))
    return steps


def _of(model: Model, fitted: Model, labels: Sequence[str]) -> Model:
    """Return a model that was fitted anew as what came of another one by further effects; against a contradiction that
    its user went on with, as that one.
    """
    kept = [note for note in model.notes if taken_as_declared([note])]
    provenance = {**model.provenance, "added": [*model.provenance.get("added", []), *labels]}
    return with_scale_spread(replace(fitted, base=model.base, provenance=provenance, notes=(*kept, *fitted.notes)))


def tells_gains(model: Model, measurements: Sequence[Measurement]) -> bool:
    """Return whether a model's gains were estimated and recordings tell them: with and without a known payload mass."""
    conditions = [measured.conditions for measured in measurements]
    carried = {(one.body or "unnamed") if one.estimated else one.payload for one in conditions}
    weighed = any(one.part.mass if one.estimated else one.payload for one in conditions)
    return bool(_estimated(model)) and len(carried) > 1 and weighed


def extended(
    model: Model,
    measurements: Sequence[Measurement],
    recordings: Callable[[], Sequence[Recording]],
    effects: Sequence[Effect],
) -> list[Model]:
    """Return a model refitted as it is, then with one effect more each time; drive gains and payloads that the same
    recordings told are found anew with each, since what was missing they had made up for.

    measurements: of the `recordings`, which are asked for where gains are found. Raises InputError as `estimate` does.
    """
    if not tells_gains(model, measurements):
        return extend(model, measurements, effects)
    read, labels = recordings(), [effect.label for effect in effects]
    return [extended_with_gains(model, read, labels[:count]) for count in range(len(labels) + 1)]


def measured_anew(model: Model) -> bool:
    """Return whether gains or payloads found with a model make its measurements others than those it came from."""
    return bool(_estimated(model) or model.payloads)


def extended_with_gains(model: Model, recordings: Sequence[Recording], labels: Sequence[str]) -> Model:
    """Return a model refitted with effects `labels` beside its own, its drives' gains found anew from the recordings.

    Raises InputError where the recordings don't tell the gains, or don't excite a parameter.
    """
    robot, processing = robot_without(model.robot, _estimated(model)), processing_of(model)
    measurements = [process(recording, robot, processing) for recording in recordings]
    structure = Structure.build(robot, [*(effect.label for effect in model.structure.added), *labels])
    known, structure, gains = with_known_gains(recordings, measurements, structure, processing)
    fitted = estimate(known, structure, estimator=model.estimator, processing=processing, gains=gains)
    return _of(model, fitted, labels)


def _estimated(model: Model) -> tuple[str, ...]:
    """Return the joints whose gain in Nm/A or N/A was estimated with the model."""
    return tuple(str(one["joint"]) for one in model.gains or () if one["unit"] != "A/A")

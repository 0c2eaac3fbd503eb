"""Identification: from recordings to a model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace

import numpy as np

from robot_ident.effects.torque_scale import TorqueScale
from robot_ident.errors import InputError, did_you_mean
from robot_ident.estimation.base_model import Choice, choose_base, torque_scale_notes
from robot_ident.estimation.carried import Carried, Solved, solve_carrying
from robot_ident.estimation.declaration import unit_notes
from robot_ident.estimation.drive_gains import Gains, spread_by_gains, with_known_gains
from robot_ident.estimation.driving import driven, implausible_notes, negative_notes
from robot_ident.estimation.effort_checks import contradictions
from robot_ident.estimation.equations import Equations, apart, stack
from robot_ident.estimation.identifiability import identifiability
from robot_ident.estimation.maximum_likelihood import position_notes
from robot_ident.estimation.problem import Solution
from robot_ident.estimation.repeatability import by_day, drift_notes, per_period
from robot_ident.estimation.solve import ESTIMATORS
from robot_ident.model.model import Fit, Model, NoiseLevel
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
        first = [made.trouble] if made.trouble else []
        return replace(made, notes=(*first, *made.notes, *told))


def with_scale_spread(model: Model) -> Model:
    """Return a model no torque scale of which has a sigma below the spread over pieces of the path that its base was
    chosen by.
    """
    spread = (model.base or {}).get("scale_spread")
    if spread is None:
        return model
    factor = np.ones(len(model.values))
    for place, (parameter, std) in enumerate(zip(model.parameters, model.std, strict=True)):
        if parameter.effect == TorqueScale.name and std > 0.0:
            factor[place] = max(1.0, spread[model.robot.joint_index(parameter.joint or "")] / std)
    return replace(model, covariance=np.asarray(model.covariance * factor * factor[:, None]))


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
    structure = structure.with_further(choice.effects)
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
    measurements, found, payloads = solved.measurements, solved.solution, solved.payloads
    taken = apart(measurements, structure.effects)
    # where a trend is part of the model, no period by itself tells it from the level
    periods = per_period(measurements, found, estimator) if taken is measurements else ()
    if gains is not None:
        found, payloads = _with_gains(solved, gains)
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
    determined = identifiability(found, measurements)
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
    residual = {}
    for joint, name in enumerate(structure.robot.joints):
        rows = equations.joint == joint
        torque = equations.torque[rows]
        residual[name] = fit(torque - equations.phi[rows] @ linear, torque, equations.variance[rows])
    implausible = implausible_notes(found.structure, equations, linear, np.sqrt(np.diag(found.covariance)))
    notes = [*determined.warnings, *before, *implausible, *notes]
    _, logdet = np.linalg.slogdet(found.covariance[: len(linear), : len(linear)])
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
        notes=(*notes, *_misfit_notes(residual, equations), *position_notes(measurements, found, estimator)),
        per_period=tuple(one.to_dict(structure.names) for one in periods),
        chi_square=found.chi_square if np.isfinite(found.chi_square) else None,
        dof=found.dof if np.isfinite(found.dof) else None,
        physical=None if consistent is None else consistent.to_dict(),
        recordings=tuple(measured.facts() for measured in measurements),
        gains=None if gains is None else tuple(gains.to_dict()),
        days=days.to_dict(structure.names),
        payloads=tuple(payload.to_dict() for payload in payloads),
    )


def _with_gains(solved: Solved, gains: Gains) -> tuple[Solution, tuple[Carried, ...]]:
    """Return solution and payloads with what the gains' uncertainty makes of their covariance."""
    found = solved.solution
    covariance, linear = np.array(found.covariance), len(found.structure.parameters)
    spread = spread_by_gains(gains, solved, found.structure, found.values[:linear])
    covariance[:linear, :linear] += spread[:linear, :linear]
    return replace(found, covariance=covariance), solved.spread(spread[linear:, linear:])


def _misfit_notes(residual: Mapping[str, Fit], equations: Equations) -> list[str]:
    """Return a line that names the joints whose residual is more than their noise."""
    joints = []
    for number, (name, fit) in enumerate(residual.items()):
        ratio = fit.mse / fit.noise_variance if fit.noise_variance else 0.0
        rows = float(np.sum(equations.independent[equations.joint == number]))
        if ratio > max(1.2, 1.0 + 5.0 * np.sqrt(2.0 / rows)):
            joints.append(f"{name} {ratio:.3g}")
    if not joints:
        return []
    return [
        f"the residual exceeds the noise, in variance: {', '.join(joints)} times; the standard deviations hold for"
        " noise alone, not for what the model lacks (robot_ident compare shows where it fails)"
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


def fit(residual: Array, torque: Array, variance: Array) -> Fit:
    """Return how well a model follows one joint: residual, torque and noise variance of its rows [R]."""
    mse, noise, size = float(np.mean(residual**2)), float(np.mean(variance)), float(np.sum(torque**2))
    relative = float(np.sqrt(np.sum(residual**2) / size)) if size else None
    return Fit(mse, float(np.sqrt(mse)), noise if np.isfinite(noise) else None, relative)

"""The error history: from model to model, on recordings that were fitted and on others."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from robot_ident.diagnosis.diagnosis import Diagnosis
from robot_ident.errors import InputError
from robot_ident.estimation.validation import mean_square_errors, validate
from robot_ident.model.model import Model
from robot_ident.recording.measurement import Source
from robot_ident.residuals.comparison import Comparison, compare


@dataclass(frozen=True)
class Level:
    """Mean square of a residual and variance of the noise of the same data, (Nm)^2; the latter None where unknown."""

    mse: float
    noise_variance: float | None

    @property
    def rms(self) -> float:
        """Root mean square of the residual, Nm."""
        return self.mse**0.5

    @property
    def noise(self) -> float | None:
        """Standard deviation of the noise, Nm; None where unknown."""
        return None if self.noise_variance is None else self.noise_variance**0.5

    @property
    def excess(self) -> float:
        """What the residual has beyond the noise, Nm rms."""
        return max(0.0, self.mse - (self.noise_variance or 0.0)) ** 0.5


@dataclass(frozen=True)
class Step:
    """One model of the staircase: where it is kept, the effects that the one before lacks, and how it fares.

    training, validation: by joint; the latter is empty without a recording to validate on.
    """

    path: str
    name: str
    model: Model
    added: tuple[str, ...]
    comparison: Comparison
    training: Mapping[str, Level]
    validation: Mapping[str, Level]


@dataclass(frozen=True)
class Foreseen:
    """A step that is not made yet: the effects that a diagnosis names, and what it predicts of the error with them."""

    added: tuple[str, ...]
    training: Mapping[str, Level]
    validation: Mapping[str, Level]


def staircase(
    models: Sequence[tuple[str, Model]], training: Sequence[Source], validation: Sequence[Source] = ()
) -> tuple[Step, ...]:
    """Return how models (path, model), in their order and as they stand, fare on recordings.

    validation: recordings that no fit has seen. Raises InputError where the models are of several robots.
    """
    first, robot = models[0][0], models[0][1].robot
    names = _names([path for path, _ in models])
    steps: list[Step] = []
    for (path, model), name in zip(models, names, strict=True):
        if model.robot.joints != robot.joints:
            raise InputError(
                f"{path}: model of another robot: joints {', '.join(model.robot.joints)};"
                f" {first} has {', '.join(robot.joints)}"
            )
        found = compare(model, [source.measured for source in training])
        held = (steps[-1].model if steps else model).structure.labels
        steps.append(
            Step(
                path=path,
                name=name,
                model=model,
                added=tuple(label for label in model.structure.labels if label not in held),
                comparison=found,
                training=_levels(found),
                validation=validated(model, validation),
            )
        )
    return tuple(steps)


def validated(model: Model, sources: Sequence[Source]) -> dict[str, Level]:
    """Return the levels on recordings that no fit has seen, by joint; their mean squares averaged over recordings.

    Of averaged periods where the motion repeats; else of moving samples behind the low pass, as `validate` has them.
    """
    each = [_on_one(model, source) for source in sources]
    out = {}
    for joint in model.robot.joints if each else ():
        levels = [one[joint] for one in each]
        noise = [level.noise_variance for level in levels if level.noise_variance is not None]
        known = len(noise) == len(levels)
        mse = sum(level.mse for level in levels) / len(levels)
        out[joint] = Level(mse, sum(noise) / len(noise) if known else None)
    return out


def foresee(step: Step, found: Diagnosis, validation: Sequence[Source] = ()) -> Foreseen | None:
    """Return what adding all that a diagnosis of a model names would do to its error; None where it names nothing that
    lowers it.
    """
    if not found.missing:
        return None
    finding = found.missing[0]  # its `after` holds all that is named
    joints = step.model.robot.joints
    if all(finding.mse_after[joint] >= step.training[joint].mse for joint in joints):
        return None
    training = {joint: Level(finding.mse_after[joint], step.training[joint].noise_variance) for joint in joints}
    unseen: dict[str, Level] = {}
    if finding.validation_after is not None and step.validation:
        each = [mean_square_errors(step.model, source.measured) for source in validation]
        for number, joint in enumerate(joints):
            # the diagnosis counts rows near standstill too: its ratio is carried over
            ratio = finding.validation_after[joint] / float(sum(one[number] for one in each) / len(each))
            unseen[joint] = Level(step.validation[joint].mse * ratio, step.validation[joint].noise_variance)
    return Foreseen(tuple(one.label for one in found.missing), training, unseen)


def _on_one(model: Model, source: Source) -> dict[str, Level]:
    if source.measured.base_frequency is not None:
        return _levels(compare(model, [source.measured]))
    low_pass = None if source.measured.low_pass is None else source.measured.low_pass.cutoff
    found = validate(model, source.recording, low_pass=low_pass)
    fits = {**found.standstill, **found.residual}  # of a joint that stands still the former is all that there is
    return {joint: Level(fit.mse, fit.noise_variance) for joint, fit in fits.items()}


def _levels(found: Comparison) -> dict[str, Level]:
    return {joint.name: Level(joint.residual_mse, joint.noise_variance) for joint in found.joints}


def _names(paths: Sequence[str]) -> list[str]:
    """Return short names: the files' own, or the whole paths where files are named alike."""
    short = [Path(path).stem for path in paths]
    return short if len(set(short)) == len(short) else list(paths)

"""Section V-B and C: a robot whose friction the model does not hold; residuals, validation, model 1 against model 2."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from robot_ident.estimation.identify import estimate
from robot_ident.estimation.prediction import measured_for
from robot_ident.estimation.validation import moving_rows, validate
from robot_ident.model.model import Model
from robot_ident.model.structure import Structure
from robot_ident.paper import printed
from robot_ident.paper.excitation import CRITERIA
from robot_ident.paper.robots import FRICTION, robot_of_section_v, without_known_effects
from robot_ident.planning.validation_motion import validation_motion
from robot_ident.recording.process import process
from robot_ident.recording.recording import Recording
from robot_ident.residuals.beside import Beside, beside
from robot_ident.signals.motion import Array
from robot_ident.testbed.phenomena import plant_physics
from robot_ident.testbed.simulation import Play, simulate
from robot_ident.trajectories.excitation import Excitation
from robot_ident.trajectories.point_to_point import PointToPoint

PERIODS = 16
_SAMPLE_RATE = 150.0


class RealRobot:
    """The robot of section V with friction that no model of the paper holds, as hardware: it only answers motions.

    seed: of all noise.
    """

    def __init__(self, motions: Mapping[str, Excitation], seed: int, hidden: Sequence[str] = FRICTION) -> None:
        """Keep the motions by their criterion."""
        self.robot, self.motions, self.seed, self.hidden = robot_of_section_v(), motions, seed, tuple(hidden)

    @cached_property
    def _plays(self) -> dict[str, Play]:
        physics = plant_physics(self.robot, list(self.hidden))
        return {
            c: Play.of(self.robot, physics, one.series, sample_rate=one.sample_rate) for c, one in self.motions.items()
        }

    def measured(self, criterion: str, draw: int = 0) -> Recording:
        """Return 16 periods of a trajectory; each draw has noise of its own."""
        return self._plays[criterion].record(PERIODS, seed=_seed(self.seed, draw, CRITERIA.index(criterion)))

    def validation(self, motion: PointToPoint, draw: int = 0) -> Recording:
        """Return the mean of 16 runs of a validation motion."""
        options: dict[str, Any] = {"effects": list(self.hidden), "seed": _seed(self.seed, draw, 99)}
        options["noise"] = 1.0 / PERIODS
        return simulate(self.robot, motion, sample_rate=_SAMPLE_RATE, **options).recording


def _seed(*parts: int) -> int:
    return int(np.random.SeedSequence(parts).generate_state(1)[0])


@dataclass(frozen=True)
class Draws:
    """Mean squared residuals of models 1 and 2 on validation motions [draws, n] (Nm)^2, noise and motion drawn anew."""

    model_1: Array
    model_2: Array

    @property
    def worse(self) -> Array:
        """Share by which model 1 is worse [draws, n]; negative where it is better."""
        return np.asarray(self.model_1 / self.model_2 - 1.0)


@dataclass(frozen=True)
class Friction:
    """Section V-B and C on the simulated robot.

    models: 1 from the c1-optimal trajectory, 2 from the c2-optimal one, model 2 without the spring, and that of a
    trajectory with the least condition number whatever the determinant. validation:
    mean squared residual [n] (Nm)^2 of each on the validation recording, everything low-passed at 10 Hz. likelihood:
    model 2 by maximum likelihood, with the Fourier coefficients of the motion among the unknowns.
    """

    models: Mapping[str, Model]
    recordings: Mapping[str, Recording]
    motion: PointToPoint
    validation_recording: Recording
    validation: Mapping[str, Array]
    draws: Draws
    likelihood: Model

    @property
    def likelihood_moves(self) -> float:
        """The largest difference of a parameter between maximum likelihood and least squares, in its sigma."""
        two = self.models["model 2"]
        count = len(two.linear)
        return float(np.max(np.abs(self.likelihood.linear - two.linear) / two.std[:count]))

    def residual(self, name: str) -> tuple[Array, Array]:
        """Return mean squared residual and noise variance [n] (Nm)^2 of a model on its own trajectory."""
        fits = self.models[name].residual.values()
        return np.array([fit.mse for fit in fits]), np.array([fit.noise_variance for fit in fits], dtype=float)

    def to_dict(self) -> dict[str, Any]:
        """Return all figures with the printed ones beside them."""
        out: dict[str, Any] = {
            name: {
                "parameters": len(model.structure.names),
                "residual_mse": self.residual(name)[0].tolist(),
                "noise_variance": self.residual(name)[1].tolist(),
                "validation_mse": self.validation[name].tolist(),
                "condition_number": model.condition_number,
                "log10_det_covariance": model.log10_det_covariance,
            }
            for name, model in self.models.items()
        }
        out["printed"] = {
            "residual_mse": list(printed.RESIDUAL),
            "noise_variance": list(printed.NOISE),
            "validation_mse": list(printed.VALIDATION),
            "model_1_worse_on_joint_1": printed.MODEL_1_WORSE,
        }
        out["maximum_likelihood_moves_sigma"] = self.likelihood_moves
        out["draws"] = {
            "count": len(self.draws.model_1),
            "model_1_worse_median": np.median(self.draws.worse, axis=0).tolist(),
            "model_1_worse_share": np.mean(self.draws.worse > 0, axis=0).tolist(),
            "model_1_worse_largest": np.max(self.draws.worse, axis=0).tolist(),
        }
        return out


def friction(real: RealRobot, motion: PointToPoint, slow: Excitation, *, draws: int) -> Friction:
    """Return section V-B and C: models from either trajectory, validated on a motion and on `draws` further ones.

    slow: the trajectory of the condition number alone, whose model is validated too.
    """
    robot = real.robot
    bare = without_known_effects(robot, "torque_offset")
    recordings = {criterion: real.measured(criterion) for criterion in real.motions}

    def fitted(criterion: str, draw: int | None = None, of: Any = robot) -> Model:
        recording = recordings[criterion] if draw is None else real.measured(criterion, draw)
        return estimate([process(recording, of)], Structure.build(of))

    models = {
        "model 1": fitted("condition"),
        "model 2": fitted("d-optimal"),
        "model 2 without the spring": fitted("d-optimal", of=bare),
    }
    alone = RealRobot({"condition": slow}, real.seed, real.hidden).measured("condition")
    models["model of the condition number alone"] = estimate([process(alone, robot)], Structure.build(robot))
    recorded = real.validation(motion)
    errors: list[list[Array]] = []
    for draw in range(1, draws + 1):
        drawn = validation_motion(robot, seed=_seed(real.seed, draw))
        seen = real.validation(drawn, draw)
        errors.append([_mse(fitted(criterion, draw), seen) for criterion in CRITERIA])
    table = np.array(errors).reshape(draws, 2, robot.n)
    return Friction(
        models,
        recordings,
        motion,
        recorded,
        {name: _mse(model, recorded) for name, model in models.items()},
        Draws(table[:, 0], table[:, 1]),
        estimate([process(recordings["d-optimal"], robot)], Structure.build(robot), estimator="ml"),
    )


def validated(model: Model, recording: Recording) -> Beside:
    """Return a model beside the mean of 16 runs of a validation motion, in the rows that the validation counts."""
    measured = measured_for(model, recording)
    found = beside(model, measured)
    return replace(found, used=moving_rows(measured), sigma=found.sigma / np.sqrt(PERIODS))


def _mse(model: Model, recording: Recording) -> Array:
    return np.array([fit.mse for fit in validate(model, recording).residual.values()])

"""Section V-A: the anti-alias filter identified and undone, and the variance of the averaged noise."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from robot_ident.estimation.identify import estimate
from robot_ident.model.model import Model
from robot_ident.model.structure import Structure
from robot_ident.paper import printed
from robot_ident.paper.friction import PERIODS
from robot_ident.planning.blends import Playback
from robot_ident.recording.process import process
from robot_ident.recording.torque_channel import FrequencyResponse, IdentifiedFilter, identify_filter
from robot_ident.robot.anti_alias import AntiAlias
from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Array
from robot_ident.testbed.simulation import simulate
from robot_ident.trajectories.excitation import Excitation

NOMINAL = AntiAlias(printed.FILTER_ORDER, printed.FILTER_CUTOFF)
_TOLERANCE = 0.04  # of frequency and quality of a section of a real filter: parts of 1 to 5 %
_ANALYSER = 0.003  # relative error of a point of a measured response
_POINTS = 100


@dataclass(frozen=True)
class Undone:
    """The 25 parameters from one recording behind the real filter: the mean squared residual over the noise variance,
    mean of all joints, and the largest error of a parameter in units of its standard deviation.
    """

    name: str
    residual_ratio: float
    largest_error: float
    parameter: str


@dataclass(frozen=True)
class MeasuringChain:
    """The real filter of the simulated robot, its measured response, what was identified, and what undoing is worth.

    noise [n]: variance of the averaged period with the right divisor, (16 - 1) 1500; noise_paper [n]: with the paper's,
    16 x 1500 - 1. rows: of the averaged period, all joints. likelihood_moves: the largest
    difference of a parameter between maximum likelihood and weighted least squares without the filter, in its sigma.
    """

    robot: Robot
    real: AntiAlias
    response: FrequencyResponse
    identified: IdentifiedFilter
    undone: tuple[Undone, ...]
    noise: Array
    noise_paper: Array
    rows: int
    likelihood_moves: float

    @property
    def false_alarm(self) -> float:
        """Deviation of chi-square over its degrees of freedom from 1, in its standard deviations, that the paper's
        divisor alone makes for a perfect model.
        """
        ratio = float(np.mean(self.noise / self.noise_paper))
        return (ratio - 1.0) / np.sqrt(2.0 / self.rows)

    def to_dict(self) -> dict[str, Any]:
        """Return all figures."""
        return {
            "real_sections": [list(section) for section in self.real.sections],
            "identified_sections": [list(section) for section in self.identified.filter.sections],
            "order": self.identified.filter.order,
            "delay": self.identified.filter.delay,
            "delay_true": self.real.delay,
            "misfit": self.identified.misfit,
            "undone": {
                one.name: {
                    "residual_ratio": one.residual_ratio,
                    "largest_error_sigma": one.largest_error,
                    "parameter": one.parameter,
                }
                for one in self.undone
            },
            "noise_variance": self.noise.tolist(),
            "noise_variance_paper_divisor": self.noise_paper.tolist(),
            "noise_variance_printed": list(printed.NOISE),
            "maximum_likelihood_moves_sigma": self.likelihood_moves,
            "false_alarm_sigma": self.false_alarm,
        }


def real_filter(seed: int) -> AntiAlias:
    """Return a filter as it is built: the poles of the Butterworth filter of order 8 at 40 Hz, off by the tolerances of
    its parts.
    """
    rng = np.random.default_rng([seed, 40])
    poles = NOMINAL.poles[NOMINAL.poles.imag > 0]
    off = np.exp(_TOLERANCE * rng.standard_normal((len(poles), 2)))
    pairs = [(abs(pole) / (2 * np.pi), abs(pole) / (-2 * pole.real)) for pole in poles]
    return AntiAlias.of_sections([(w * a, q * b) for (w, q), (a, b) in zip(pairs, off, strict=True)])


def measured_response(filter_: AntiAlias, seed: int) -> FrequencyResponse:
    """Return what an analyser reads of a filter from 1 to 120 Hz."""
    rng = np.random.default_rng([seed, 41])
    frequency = np.geomspace(1.0, 120.0, _POINTS)
    error = _ANALYSER * (rng.standard_normal(_POINTS) + 1j * rng.standard_normal(_POINTS))
    value = filter_.response(frequency) * (1.0 + error)
    return FrequencyResponse(frequency, value, np.ones(_POINTS, dtype=bool), None, "analyser")


def measuring_chain(robot: Robot, excitation: Excitation, *, seed: int) -> MeasuringChain:
    """Return section V-A on the simulated robot of section V, which records 16 periods behind its real filter."""
    real = real_filter(seed)
    response = measured_response(real, seed)
    identified = identify_filter(response)
    played = Playback(excitation, robot, PERIODS)
    steady = (played.transient, excitation.period, PERIODS)
    built = replace(robot, anti_alias=(real,) * robot.n)
    recording = simulate(
        built, played, sample_rate=excitation.sample_rate, steady=steady, seed=seed, anti_alias=True
    ).recording
    undone = []
    for name, kind in (("ignored", None), ("nominal", NOMINAL), ("identified", identified.filter)):
        known = replace(robot, anti_alias=() if kind is None else (kind,) * robot.n)
        model = estimate([process(recording, known)], Structure.build(known))
        undone.append(_judged(name, model))
    plain = simulate(robot, played, sample_rate=excitation.sample_rate, steady=steady, seed=seed).recording
    measured = process(plain, robot)
    noise = np.asarray(measured.torque_variance) / PERIODS
    least, most = (estimate([measured], Structure.build(robot), estimator=name) for name in ("wls", "ml"))
    moved = float(np.max(np.abs(most.linear - least.linear) / least.std[: len(least.linear)]))
    samples = round(excitation.period * excitation.sample_rate)
    divisor = (PERIODS - 1) * samples / (PERIODS * samples - 1)
    return MeasuringChain(
        robot, real, response, identified, tuple(undone), noise, noise * divisor, samples * robot.n, moved
    )


def _judged(name: str, model: Model) -> Undone:
    true = model.structure.true_values()
    error = (model.linear - true) / model.std[: len(true)]
    worst = int(np.argmax(np.abs(error)))
    ratios = [fit.mse / fit.noise_variance for fit in model.residual.values() if fit.noise_variance]
    return Undone(name, float(np.mean(ratios)), float(error[worst]), model.structure.names[worst])

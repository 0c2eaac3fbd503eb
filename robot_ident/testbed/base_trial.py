"""Recordings with the faults of real ones: is the base model that is chosen as good as the best fixed filter?

Each case draws a servo, its encoders, friction, offsets and scales, identifies without an option, and predicts the
exact torque of another path; beside it stand models of fixed filters that are told which offsets and scales there are.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from robot_ident.effects.torque_scale import TorqueScale
from robot_ident.errors import InputError
from robot_ident.estimation.identify import identify
from robot_ident.model.model import Model
from robot_ident.recording.measurement import Processing
from robot_ident.robot.robot import Robot
from robot_ident.testbed.like_real import KINDS, LikeReal, like_real
from robot_ident.testbed.trial import AsData, Case
from robot_ident.testbed.trial_table import Rate

FILTERS = tuple((low, wide) for low in (2.0, 5.0, 10.0) for wide in (1.0, 4.0))
"""Low passes [Hz] of the rows, and how many times that positions are differentiated to."""
CLOSE = 1.05
"""How much more error than the best fixed filter counts as being as good."""

_NYQUIST_SHARE = 0.4  # of the rate: what a filter has to lie below
_SIGMAS = 2.0


@dataclass(frozen=True)
class BaseOutcome(AsData):
    """What one seed gave.

    error, fixed: rms over all joints of the error over the exact torque's standard deviation, of the chosen base model
    and of the best fixed filter (best: low pass and differentiation, Hz). scaled: whether efforts had scales of their
    own; scales: by joint (found, sigma, truth). refused: the message where no model was identified.
    """

    seed: int
    kind: str
    rate: float
    error: float | None
    fixed: float
    best: tuple[float, float]
    scaled: bool
    scales: Mapping[str, tuple[float, float, float]]
    chosen: Mapping[str, Any]
    seconds: float
    refused: str = ""

    @property
    def ratio(self) -> float:
        """Error over that of the best fixed filter; infinite where there is no model."""
        return float("inf") if self.error is None else self.error / self.fixed


def run_base_case(case: Case, robot: Robot) -> BaseOutcome:
    """Draw what one seed gives, identify without an option and with every fixed filter."""
    drawn = like_real(robot, case.seed)
    scaled = bool(drawn.scale.std() > 0)
    fixed = {(low, low * wide): _fixed(drawn, robot, low, low * wide) for low, wide in FILTERS}
    best, least = min(((key, value) for key, value in fixed.items() if value is not None), key=lambda one: one[1])
    outcome = BaseOutcome(case.seed, drawn.kind, drawn.rate, None, least, best, scaled, {}, {}, 0.0)
    started = time.process_time()
    try:
        model = identify([drawn.train], replace(robot, base="prediction"), as_declared=True)
    except InputError as error:
        return replace(outcome, refused=str(error))
    seconds = time.process_time() - started
    truth = dict(zip(robot.joints, drawn.scale, strict=True))
    scales = {
        p.joint: (float(value), float(std), float(truth[p.joint]))
        for p, value, std in zip(model.parameters, model.values, model.std, strict=True)
        if p.effect == TorqueScale.name and p.joint
    }
    chosen = {key: value for key, value in (model.base or {}).items() if key != "compared"}
    return replace(outcome, error=_error(model, drawn), scales=scales, chosen=chosen, seconds=seconds)


def _fixed(case: LikeReal, robot: Robot, low: float, wide: float) -> float | None:
    """Return the error of a model with a fixed filter that is told what there is; None beyond what the rate holds."""
    if wide > _NYQUIST_SHARE * case.rate:
        return None
    effects = ["torque_offset@*"] + [f"torque_scale@{joint}" for joint in robot.joints[1:] if case.scale.std() > 0]
    if robot.n > 3:  # up to three joints, rotors merge with links or are declared
        effects.append("rotor_inertia@*")
    every = max(1, int(case.rate / (4.0 * low)))
    processing = Processing(periodic=False, low_pass=low, derivative_bandwidth=wide, decimate=every)
    declared = replace(robot, base="declared")
    model = identify([case.train], declared, effects=effects, processing=processing, as_declared=True)
    return _error(model, case)


def _error(model: Model, case: LikeReal) -> float:
    """Return the rms error along the unseen path, over each joint's standard deviation of the exact torque."""
    return float(np.sqrt(np.mean(case.errors(model) ** 2)))


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def base_summary(outcomes: Sequence[BaseOutcome]) -> dict[str, Any]:
    """Return ratios by kind of path, and how often scales were found, invented, and within two sigma.

    A case without a model is worse than any ratio: None where it decides.
    """
    kinds = []
    for kind in KINDS:
        own = [one for one in outcomes if one.kind == kind]
        if own:
            ratio = np.array([one.ratio for one in own])
            kinds.append(
                {
                    "kind": kind,
                    "cases": len(own),
                    "median": _finite(np.quantile(ratio, 0.5, method="lower")),
                    "ninetieth_percentile": _finite(np.quantile(ratio, 0.9, method="higher")),
                    "worst": _finite(ratio.max()),
                    "as_good": int(np.sum(ratio <= CLOSE)),
                    "exceptions": [one.seed for one in own if one.ratio > CLOSE],
                }
            )
    scaled = [one for one in outcomes if one.scaled]
    plain = [one for one in outcomes if not one.scaled]
    found, invented = ([(one.seed, bool(one.scales)) for one in some] for some in (scaled, plain))
    within = [
        (one.seed, abs(value - true) < _SIGMAS * std) for one in scaled for value, std, true in one.scales.values()
    ]
    rates = [
        Rate.of("scales found where there are some", found, hoped=True),
        Rate.of("scales invented where there are none", invented, hoped=False),
        Rate.of("scales within two sigma", within, hoped=True),
    ]
    seconds = [one.seconds for one in outcomes if not one.refused]
    return {
        "kinds": kinds,
        "rates": [rate.to_dict() for rate in rates if rate.cases],
        "seconds": float(np.median(seconds)) if seconds else None,
        "refused": {str(one.seed): one.refused for one in outcomes if one.refused},
    }

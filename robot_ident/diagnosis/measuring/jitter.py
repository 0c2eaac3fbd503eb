"""Samples off the clock: positions scatter from period to period the more the faster the joints move."""

from __future__ import annotations

from dataclasses import replace

from robot_ident.diagnosis.before_after import mean_squares
from robot_ident.diagnosis.diagnosis import Diagnosis, Estimate, Finding
from robot_ident.effects.catalogue import CATALOGUE
from robot_ident.regression.evidence import Evidence

SIGMAS = 6.0  # of the evidence, over all recordings together
LEAST = 0.01  # of the sample time, below which jitter is of no consequence


def with_jitter(found: Diagnosis, evidence: Evidence) -> Diagnosis:
    """Return a diagnosis with samples off the clock named as well, where the periods show them."""
    jitter = jitter_finding(evidence)
    return found if jitter is None else replace(found, verdict="missing", missing=(*found.missing, jitter))


def jitter_finding(evidence: Evidence) -> Finding | None:
    """Return samples off the clock as a finding, None where the periods don't show any.

    It makes no torque: what it leaves in the mean is what there was.
    """
    from scipy.special import ndtr

    told = [(m, m.off_clock) for m in evidence.recordings if m.off_clock is not None]
    if not told:
        return None
    sigmas = sum(found.sigmas for _, found in told) / len(told) ** 0.5
    sizes = [found.size / m.sample_rate for m, found in told]
    size = (sum(s**2 for s in sizes) / len(sizes)) ** 0.5
    if sigmas < SIGMAS or max(found.size for _, found in told) < LEAST:
        return None
    mse = mean_squares(evidence)
    return Finding(
        effect=CATALOGUE["stamp_jitter"](evidence.structure.robot, None),
        p_value=float(ndtr(-sigmas)),
        explained=0.0,
        mse_before=mse,
        mse_after=mse,
        validation_before=None,
        validation_after=None,
        parameters=(Estimate("stamp_jitter", 1e3 * size, 500.0 * size / sigmas * len(told) ** 0.5, "ms"),),
        tied_with=(),
        experiment=None,
        fix="the driver or recorder: stamp samples when they are taken (the header's stamp, not that of arrival)",
    )

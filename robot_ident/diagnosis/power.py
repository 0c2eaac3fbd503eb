"""How much data a verdict takes; and a model whose friction drives its joints, which is no adequate one, however well
it fits.
"""

from __future__ import annotations

from dataclasses import replace
from math import ceil

import numpy as np

from robot_ident.diagnosis.diagnosis import Diagnosis
from robot_ident.estimation.driving import driven
from robot_ident.regression.evidence import Evidence

ENOUGH = 40.0  # chi-square units that an effect must gain before it may be named
LEAST = 0.003  # of a joint's torque, rms, that an effect must make to be worth a name


def least_torque(evidence: Evidence, joint: int) -> float:
    """Return the torque, rms, that something on a joint must make to be worth a name: a share of what was measured."""
    torque = np.concatenate([t.measured.torque[:, joint] for t in evidence.trajectories])
    return LEAST * float(np.sqrt(np.mean(torque**2)))


def too_little(best: float, evidence: Evidence) -> tuple[str, ...]:
    """Return how much more data would tell, where the model misfits by too little for any effect to stand out.

    best: what the best effect gains, in units of chi-square; it grows in proportion to the periods that are averaged.
    Empty where more data wouldn't help: some effect gains enough as it is, and yet none explains the error.
    """
    if not 0.0 < best < ENOUGH:
        return ()
    periods = min(t.measured.periods for t in evidence.trajectories)
    more = max(1, ceil(periods * ENOUGH / best) - periods)
    return (
        f"too little data for a verdict: the model misfits, but the best effect gains {best:.0f} where {ENOUGH:.0f} are"
        f" needed; record about {more} more periods of each motion, or another motion",
    )


def unseen_below(evidence: Evidence) -> str:
    """Return what could have stayed unseen: the rms torque by joint whose gain would not have sufficed."""
    parts = []
    for joint, name in enumerate(evidence.structure.robot.joints):
        information = sum(float(np.sum(t.weight[:, joint] ** 2)) for t in evidence.trajectories)
        rows = sum(float(np.sum(t.weight[:, joint] > 0)) for t in evidence.trajectories)
        if information > 0.0:
            level = np.sqrt(ENOUGH * rows / information / max(rows, 1.0))
            parts.append(f"{name} {level:.2g} {evidence.structure.robot.torque_unit(joint)}")
    return "an effect of which the model absorbs nothing would have shown from so much rms on: " + ", ".join(parts)


def with_doubt(found: Diagnosis, evidence: Evidence) -> Diagnosis:
    """Return a diagnosis with what is wrong about the friction of the model as it was given, before all other notes.

    What is reversed in time, or in the signs of both positions and efforts, fits to the noise with negative friction:
    not decidable rather than adequate. Single coefficients are doubted where nothing is missing that would bend them.
    What of the efforts was cut off is said, too.
    """
    phi = np.concatenate([columns.reshape(-1, columns.shape[2]) for columns in evidence.phi])
    covariance = np.linalg.pinv(phi.T @ phi, hermitian=True)
    wrong = driven(evidence.structure, evidence.recordings, evidence.values, covariance)
    if found.verdict != "adequate":
        wrong = replace(wrong, coefficients={})
    verdict = "not_decidable" if found.verdict == "adequate" and wrong.notes else found.verdict
    cut_off = [f"{measured.source}: {note}" for measured in evidence.recordings for note in measured.clipped]
    return replace(found, verdict=verdict, notes=(*wrong.notes, *cut_off, *found.notes))

"""A model whose friction drives its joints is no adequate one, however well it fits."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from robot_ident.diagnosis.diagnosis import Diagnosis
from robot_ident.diagnosis.evidence import Evidence
from robot_ident.estimation.driving import driven


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

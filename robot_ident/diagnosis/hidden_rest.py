"""An adequate model may leave more than noise over: what the hidden part of the path makes of the torque."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from robot_ident.diagnosis.diagnosis import Diagnosis
from robot_ident.regression.evidence import Evidence
from robot_ident.regression.hidden_path import note
from robot_ident.regression.misfit import misfit


def with_hidden_rest(found: Diagnosis, evidence: Evidence) -> Diagnosis:
    """Return a diagnosis with the joints at which an adequate model doesn't fit as it stands, and a note.

    evidence: on the model as it was given, not whitened: judged as `compare` judges.
    """
    if found.verdict != "adequate":
        return found
    robot = evidence.structure.robot
    phi = np.concatenate([columns.reshape(-1, columns.shape[2]) for columns in evidence.phi])
    tests = misfit(evidence, np.linalg.pinv(phi.T @ phi, hermitian=True))
    joints = tuple(name for name, test in zip(robot.joints, tests, strict=True) if test.fails)
    if not joints:
        return found
    return replace(found, notes=(*found.notes, note(joints)), hidden_in_path=joints)

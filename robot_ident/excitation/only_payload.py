"""What to excite where the arm is known and only what it carries is asked for."""

from __future__ import annotations

import numpy as np

from robot_ident.excitation.target import Target
from robot_ident.model.base_parameters import random_states
from robot_ident.signals.motion import Array

_SAMPLES = 1500  # of a period
_FIRMLY = 1e3  # times what one averaged period of a motion tells of the arm


def all_but_payload(target: Target) -> Array:
    """Return information [p, p] about everything that a payload leaves as it is: a prior for a design.

    A payload changes the ten parameters of the last link; in the base parameters that is R_last pi, so that what stands
    across R_last is known: P = k N N' with N' R_last = 0, in units of what the noise makes of each parameter. Friction
    stays free: it differs with the load.
    """
    structure = target.structure
    own = structure.base.regrouping[:, 10 * (target.robot.n - 1) : 10 * target.robot.n]
    size = _sizes(target)
    base = size[: len(own)]
    left, values, _ = np.linalg.svd(own / base[:, None])
    rank = int(np.sum(values > 1e-9 * values[0]))
    across = left[:, rank:] / base[:, None]
    lasting = {effect.name for effect in structure.effects if effect.symmetry == "conservative"}
    firm = [p.effect in lasting for p in structure.parameters]
    out = np.diag(np.where(firm, (_FIRMLY / size) ** 2, 0.0))
    out[: len(own), : len(own)] = _FIRMLY**2 * across @ across.T
    return out


def _sizes(target: Target) -> Array:
    """Return the standard deviation of each parameter alone [p] where a period of samples passes random states; of
    effects, whose columns may need a motion, as if these were 1.
    """
    columns = target.structure.rigid_columns(random_states(target.robot))
    rigid = np.mean(np.sum(columns**2 / target.variances[:, None], axis=1), axis=0)
    further = len(target.structure.parameters) - len(rigid)
    power = np.concatenate([rigid, np.full(further, float(np.mean(1.0 / target.variances)))])
    return np.asarray(1.0 / np.sqrt(_SAMPLES * np.where(power > 0, power, 1.0)))

"""What Swevers et al. (1997) report of the KUKA IR 361: Table II and section IV, for the paper's 21 parameters.

For one averaged period: 1500 samples a joint, torque noise of variance 25, 26, 10 (Nm)^2, SI units.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

PARAMETERS: tuple[str, ...] = (
    *(f"p{k}" for k in range(1, 16)),
    *(f"{effect}@joint_{k}" for effect in ("viscous", "coulomb") for k in (1, 2, 3)),
)

_SIGMA = {
    "condition": """.2024 .0283 .0251 .3678 .1828 .1592 .1459 .1953 .0115 .0178 .2881 .1563 .0791 .0757 .0679
        .4178 .2111 .3497 .2345 .1731 .1429""",
    "d-optimal": """.1503 .0303 .0199 .1674 .0878 .0866 .0920 .1449 .0140 .0152 .1184 .0616 .0343 .0436 .0463
        .4366 .2872 .3008 .2248 .2185 .1970""",
}
SIGMA: dict[str, tuple[float, ...]] = {
    criterion: tuple(float(word) for word in words.split()) for criterion, words in _SIGMA.items()
}
"""Table II: predicted standard deviations of the trajectory of either criterion, in the order of PARAMETERS."""

LOG10_DET = {"d-optimal": math.log10(2.36e-49), "condition": math.log10(1.76e-43)}
CONDITION = {"d-optimal": 5.94, "condition": 4.15}


def is_paper_model(robot: str, parameters: Sequence[str]) -> bool:
    """Return whether a design is for the paper's robot and its 21 parameters."""
    return robot == "kuka_ir361" and tuple(parameters) == PARAMETERS

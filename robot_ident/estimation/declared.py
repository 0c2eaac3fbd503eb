"""What a recording says of a joint's effort, as the robot YAML declares it."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

NOT_TOLD = float("nan")


@dataclass(frozen=True)
class Declared:
    """What a recording says of a joint's effort: `share` of the URDF's gravity torque (of the inertial one where the
    joint carries no gravity) that is found in it, with its standard deviation, the verdict, and what to look at.

    verdict: consistent, compensated (gravity is taken out), included (though declared to be taken out), sign, factor,
    driven where friction gives energy, clock where time explains all joints, or not_told where the motion loads the
    joint too little, or the URDF's torque is hardly in its effort. gravity, inertia: both shares, nan where not told.
    friction: power that is lost over the product of rms torque and rms speed; negative where effort has the wrong sign.
    explained: part of the effort, friction left aside, that the URDF's torque times those shares accounts for.
    """

    joint: str
    share: float
    std: float
    verdict: str
    hint: str
    gravity: float = NOT_TOLD
    inertia: float = NOT_TOLD
    friction: float = 0.0
    explained: float = 0.0

    def to_dict(self) -> dict[str, Any]:
        """Return it as `info --json` prints it: null where nothing is told."""
        values = asdict(self)
        return {key: None if isinstance(v, float) and not np.isfinite(v) else v for key, v in values.items()}

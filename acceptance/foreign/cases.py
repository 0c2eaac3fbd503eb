"""Cases of the second simulator: what is hidden, where, how large, and the recordings that show it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from foreign.arm import Array
from foreign.effects import JOINTS, KNOWN, UNKNOWN, Draw
from foreign.world import Hidden, Scene, Seen, Servo, recorded, scenes, sized

LARGEST, SMALLEST = 8.0, 1.2  # Nm rms that a hidden effect leaves
POSSIBLE = (0.25, 4.0)  # of the usual size: what is smaller or larger than that no arm has
RANGE = {"time_delay": (0.5, 3.3)}  # 3 to 20 ms: less is less than half a sample
NAMES = ("joint_1", "joint_2", "joint_3")
WITHOUT_JOINT = ("base_tilt",)


@dataclass(frozen=True)
class ForeignCase:
    """What is hidden (`name@joint`, None where nothing is that the catalogue knows), and t, q, tau of each motion."""

    truth: str | None
    what: str
    visible: Array
    recordings: tuple[tuple[Array, Array, Array], ...]


def nothing(scene: Scene, size: float) -> Seen:
    return Seen(scene.path.q, scene.torque)


def make_case(
    seed: int,
    kind: str,
    motions: Sequence[Mapping[str, Any]],
    *,
    periods: int = 16,
    noise: float = 1.0,
    clean: int = 0,
) -> ForeignCase:
    """Return a case of a kind (`known`, `unknown`, `null`); the last `clean` motions are recorded without noise."""
    rng = np.random.default_rng([seed, 4711])
    made = scenes(motions, Servo.draw(rng))
    training = tuple(made[: len(made) - clean])
    hidden: Hidden = nothing
    name, joint, size, left = "nothing", 0, 0.0, np.zeros(3)
    for _ in range(20):
        if kind == "null":
            break
        choice = KNOWN if kind == "known" else UNKNOWN
        name = str(rng.choice(list(choice)))
        joint = int(rng.choice(JOINTS.get(name, (0, 1, 2))))
        hidden = choice[name](Draw(rng, joint, training))
        target = float(np.exp(rng.uniform(np.log(SMALLEST), np.log(LARGEST))))
        size, left = sized(training, hidden, target, 1.0)
        low, high = RANGE.get(name, POSSIBLE)
        if low < size < high and left.max() > 0.9 * SMALLEST:
            break
    label = name if name in WITHOUT_JOINT else f"{name}@{NAMES[joint]}"
    recordings = tuple(
        recorded(scene, hidden, size, periods=periods, noise=0.0 if k >= len(training) else noise, rng=rng)
        for k, scene in enumerate(made)
    )
    return ForeignCase(label if kind == "known" else None, f"{label} x {size:.3g}", left, recordings)

"""An effort that is reported in another scale than those of the other joints."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from robot_ident.effects.effect import Effect, Inner, Mathematics, Signals

SPREAD = 0.2
"""Standard deviation of ln a before data: what drives of one kind differ by."""


class TorqueScale(Effect):
    """What the links ask of a joint, reported a times: its share in parameters that joints have in common says so.

    A drive's torque constant, a gear ratio or a sensor's gain that is off makes it, and so does what the links' model
    lacks (a counterbalance, a wrong length): it serves prediction, and is a drive's gain only where a known payload
    says the same. The joint's own columns, friction among them, stay in the unit that is reported. It has no column of
    its own: the structure multiplies the joint's rows of the links' columns.
    """

    name = "torque_scale"
    equation = "a tauL for tauL"
    meaning = "scale of the reported torque beside the other joints'"
    coefficients = ()
    inner = (Inner("scale", "", "", 0.2, 5.0, (1.0,), logarithmic=True),)
    symmetry = "conservative"
    signature = "torque of the links that other joints' rows contradict"
    confused_with = ("load_friction", "torque_saturation")
    also_like = ("a gear ratio or a torque constant that is off", "a counterbalance", "a wrong link length")
    experiment = "hold a known payload: its weight must show with the same mass at every joint that carries it"
    magnitude = "2-40 %"
    scales_links = True
    relative = True
    candidate = False

    @property
    def scale(self) -> float:
        """The factor a."""
        return self.setting["scale"]

    def parameter_names(self) -> tuple[str, ...]:
        """Return none: it is linear in nothing."""
        return ()

    def inner_names(self) -> tuple[str, ...]:
        """Return its label."""
        return (self.label,)

    def full_terms(self, x: Signals, m: Mathematics) -> Sequence[dict[int, Any]]:
        """Return no column."""
        return []

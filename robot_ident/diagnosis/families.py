"""What effects that recordings can't tell apart have in common."""

from __future__ import annotations

from collections.abc import Collection

FAMILIES: dict[str, frozenset[str]] = {
    name: frozenset(members.split())
    for name, members in {
        "static in q": "cable gravity_spring base_tilt end_stop torque_offset encoder_eccentricity torque_ripple",
        "friction over speed": "viscous coulomb stribeck viscous_nonlinear viscous_asymmetric temperature_drift",
        "around reversals": "presliding time_delay backlash stribeck joint_elasticity",
        "over the load": "load_friction torque_saturation joint_elasticity",
        "friction that varies over the path": "position_friction load_friction coulomb",
        "over acceleration": "rotor_inertia payload joint_elasticity time_delay",
    }.items()
}


FRICTION = frozenset(
    (
        "viscous",
        "coulomb",
        "stribeck",
        "viscous_asymmetric",
        "viscous_nonlinear",
        "presliding",
        "load_friction",
        "position_friction",
        "joint_coupling",
        "temperature_drift",
    )
)
"""Effects that rub: what is blamed first, and wrongly where the measuring is at fault."""


def family(names: Collection[str]) -> str | None:
    """Return the family that holds all effects of some names, None where none does."""
    return next((name for name, members in FAMILIES.items() if members.issuperset(names)), None)

"""The catalogue of physical effects, one small file each: its equation gives columns, gradients and documentation."""

from __future__ import annotations

from robot_ident.effects.catalogue import (
    CATALOGUE,
    beside,
    candidates_of,
    holder,
    make_effect,
    refuse_unseen,
    register,
    unseen_of,
)
from robot_ident.effects.effect import Coefficient, Course, Effect, Inner, Mathematics, Sensitivity, Signals, Torques
from robot_ident.effects.load_file import load_effects

__all__ = [
    "CATALOGUE",
    "Coefficient",
    "Course",
    "Effect",
    "Inner",
    "Mathematics",
    "Sensitivity",
    "Signals",
    "Torques",
    "beside",
    "candidates_of",
    "holder",
    "load_effects",
    "make_effect",
    "refuse_unseen",
    "register",
    "unseen_of",
]

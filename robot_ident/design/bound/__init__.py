"""How good can an excitation be: a bound of the determinant that no trajectory within the limits passes."""

from __future__ import annotations

from robot_ident.design.bound.bound import TIME_LIMIT, Bound, determinant_bound
from robot_ident.design.bound.relaxation import Proof

__all__ = ["TIME_LIMIT", "Bound", "Proof", "determinant_bound"]

"""What every effect has to declare, for those of the catalogue and of users alike."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import get_args

from robot_ident.effects.effect import Coefficient, Effect, Inner, Scope, Symmetry

_TEXTS = ("name", "equation", "meaning", "signature")


def problems(kind: type[Effect]) -> list[str]:
    """Return what is missing or wrong in the declarations of an effect, each in a few words."""
    return [*_texts(kind), *_choices(kind), *_coefficients(kind), *_inner(kind), *_methods(kind)]


def _texts(kind: type[Effect]) -> Iterator[str]:
    for field in _TEXTS:
        text = getattr(kind, field, None)
        if not isinstance(text, str) or not text.strip():
            yield f"{field} is missing (a text)"
    name = getattr(kind, "name", "")
    if isinstance(name, str) and name and not re.fullmatch(r"[a-z][a-z0-9]*(_[a-z0-9]+)*", name):
        yield f"name {name!r} isn't in snake_case"


def _choices(kind: type[Effect]) -> Iterator[str]:
    for field, known in (("symmetry", get_args(Symmetry)), ("scope", get_args(Scope))):
        value = getattr(kind, field, None)
        if value not in known:
            yield f"{field} = {value!r}; known: {', '.join(known)}"


def _coefficients(kind: type[Effect]) -> Iterator[str]:
    coefficients = getattr(kind, "coefficients", ())
    if not isinstance(coefficients, tuple) or not (coefficients or kind.scales_links):
        yield "coefficients is missing (a tuple of Coefficient)"
        return
    if not all(isinstance(c, Coefficient) for c in coefficients):
        yield "coefficients holds something that is no Coefficient"
        return
    yield from _twice([c.name for c in coefficients], "coefficients")
    for c in coefficients:
        if not (c.unit and c.unit_prismatic):
            yield f"coefficient {c.name!r} has no unit"


def _inner(kind: type[Effect]) -> Iterator[str]:
    if not isinstance(kind.inner, tuple) or not all(isinstance(i, Inner) for i in kind.inner):
        yield "inner is no tuple of Inner"
        return
    yield from _twice([i.name for i in kind.inner], "inner")
    for i in kind.inner:
        if not i.grid:
            yield f"inner {i.name!r} has an empty grid"
        elif not i.lower <= min(*i.grid, *i.grid_prismatic, i.grid[0]) or not i.upper >= max(
            *i.grid, *i.grid_prismatic, i.grid[0]
        ):
            yield f"inner {i.name!r}: its grid leaves its bounds {i.lower:g} to {i.upper:g}"
        if i.logarithmic and i.lower <= 0:
            yield f"inner {i.name!r} is logarithmic, but its lower bound is {i.lower:g}"


def _methods(kind: type[Effect]) -> Iterator[str]:
    writes = kind.full_terms is not Effect.full_terms
    if not writes and kind.full_columns is Effect.full_columns:
        yield "it writes neither full_terms nor full_columns"
    if kind.symbolic and not writes:
        yield "symbolic is True, but it writes no full_terms"


def _twice(names: list[str], field: str) -> Iterator[str]:
    for name in sorted({name for name in names if names.count(name) > 1}):
        yield f"{field} holds {name!r} twice"

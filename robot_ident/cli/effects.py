"""`robot_ident effects`."""

from __future__ import annotations

import argparse
from typing import Any

from robot_ident.cli.output import print_json, say, table
from robot_ident.effects import CATALOGUE, Effect, Inner
from robot_ident.errors import InputError, did_you_mean
from robot_ident.testbed.phenomena import PHYSICS, formula


def run(args: argparse.Namespace) -> None:
    """Print the catalogue, or all about one effect."""
    if args.name is not None and args.name not in CATALOGUE:
        raise InputError(f"unknown effect {args.name!r}{did_you_mean(args.name, CATALOGUE)}")
    chosen = [CATALOGUE[args.name]] if args.name else list(CATALOGUE.values())
    if args.json:
        print_json({"schema": "robot_ident/effects/1", "effects": [describe(effect) for effect in chosen]})
    elif args.name:
        say(page(chosen[0]))
    else:
        say(
            table(
                ("effect", "torque", "in time", "meaning"),
                [(one.name, one.equation, one.symmetry, one.meaning) for one in chosen],
            )
        )


def describe(effect: type[Effect]) -> dict[str, Any]:
    """Return all that an effect declares."""
    return {
        "name": effect.name,
        "meaning": effect.meaning,
        "equation": effect.equation,
        "scope": effect.scope,
        "symmetry": effect.symmetry,
        "parameters": [_named(c, "name", "unit", "unit_prismatic", "positive") for c in effect.coefficients],
        "inner": [
            _named(i, "name", "unit", "unit_prismatic", "lower", "upper", "grid", "continuous") for i in effect.inner
        ],
        "signature": effect.signature,
        "confused_with": list(effect.confused_with),
        "also_like": list(effect.also_like),
        "experiment": effect.experiment or None,
        "magnitude": effect.magnitude or None,
        "seen_from": list(effect.seen_from),
        "regression": effect.regression,
        "evidence": effect.evidence or None,
        "measuring": effect.measuring,
    }


def _named(parameter: Any, *names: str) -> dict[str, Any]:
    return {name: getattr(parameter, name) for name in names}


def page(effect: type[Effect]) -> str:
    """Return all about one effect, a line for each thing."""
    places = {"joint": ("@JOINT",), "robot": ("",), "joint_or_robot": ("@JOINT", " (all joints alike)")}[effect.scope]
    where = ", or ".join(effect.name + place for place in places)
    lines = [
        ("", effect.meaning),
        ("written", where),
        ("torque", effect.equation),
        *(("parameter", f"{c.name} [{_unit(c)}]{', not negative' if c.positive else ''}") for c in effect.coefficients),
        *(("inner parameter", _inner(i)) for i in effect.inner),
        ("in time", _SYMMETRY[effect.symmetry]),
        ("in a residual", effect.signature),
        ("evidence", effect.evidence),
        ("seen from", f"motor and joint side; {effect.before_sensor}" if "link" not in effect.seen_from else ""),
        ("confused with", ", ".join((*effect.confused_with, *effect.also_like))),
        ("told by", effect.experiment),
        ("usual size", effect.magnitude + (" (industrial arm / cobot)" if effect.magnitude else "")),
    ]
    lines += _simulated(effect.name)
    return "\n".join([effect.name, *(f"  {name:16s}{text}" if name else f"  {text}" for name, text in lines if text)])


def _simulated(name: str) -> list[tuple[str, str]]:
    """Return how the simulated robot makes an effect and what `simulate --effect` may say of it."""
    if name not in PHYSICS:
        return []
    kind = PHYSICS[name]
    first, place = kind.parameters[0].name, "" if kind.scope == "robot" else "@JOINT"
    return [
        ("simulated", f"{formula(kind)} (a formula of its own: its values differ from those identified)"),
        ("simulate with", f"--effect {name}{place}:{first}=VALUE,...; a bare :VALUE is {first}"),
        *(("value", f"{p.name} [{_unit(p)}]") for p in kind.parameters),
    ]


_SYMMETRY = {
    "dissipative": "dissipative: turns its sign when a motion runs backwards",
    "conservative": "conservative: the same when a motion runs backwards",
    "memory": "memory: depends on what went before",
    "mixed": "mixed: in part dissipative, in part conservative",
}


def _unit(parameter: Any) -> str:
    unit, prismatic = parameter.unit or "-", parameter.unit_prismatic or "-"
    return f"{unit}" if unit == prismatic else f"{unit}; prismatic {prismatic}"


def _inner(inner: Inner) -> str:
    grid = ", ".join(f"{value:g}" for value in inner.grid)
    if not inner.continuous:
        return f"{inner.name} [{_unit(inner)}], one of {grid}"
    return f"{inner.name} [{_unit(inner)}], searched at {grid}, then between {inner.lower:g} and {inner.upper:g}"

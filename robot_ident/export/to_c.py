"""C for a controller: torque, gravity and friction as functions without memory, allocation or libraries.

CasADi generates straight-line code of the whole model; a header gives it plain arrays. Dry friction steps with the sign
of a velocity, which a controller must not feed forward near standstill: within a small speed v_s the sign is replaced
by x (3 - x^2) / 2, x = v / v_s, which meets it with equal slope.
"""

from __future__ import annotations

import re
from typing import Any

import numpy as np

from robot_ident.effects.own import is_own
from robot_ident.errors import InputError, one_line
from robot_ident.export.exported import Exported
from robot_ident.model.expressions import columns_function
from robot_ident.model.model import Model
from robot_ident.model.structure import Structure
from robot_ident.signals.motion import Array

_FUNCTIONS = {
    "torque": ("q, dq, ddq", "torque of the whole model"),
    "gravity": ("q", "torque of the whole model at rest, without dry friction"),
    "friction": ("q, dq", "torque of what rubs: the whole model at constant speed less that at rest, the links aside"),
}
_EXPORTED = re.compile(
    r"^CASADI_SYMBOL_EXPORT [\w ]+\** (?P<name>\w+)\([^\n]*(?:\{[^\n]*\}\n|\{\n.*?^\}\n)", re.MULTILINE | re.DOTALL
)
"""A function that CasADi lets others call; beside each there are a dozen that say how much memory it wants."""

_SHAPES = re.compile(r"^(?:static const casadi_int casadi_s\d+\[|#define casadi_s\d+ ).*\n", re.MULTILINE)
"""The shapes of inputs and outputs, which those functions tell."""

_BODY = re.compile(r"^static int casadi_f\d+\([^\n]*\) \{\n", re.MULTILINE)
"""The head of a function that has all the arguments of its kind and may need only some."""

_TAKEN = re.compile(
    "assert|complex|ctype|errno|fenv|float|inttypes|iso646|limits|locale|math|setjmp|signal|stdalign|stdarg|stdatomic|stdbool"
    "|stddef|stdint|stdio|stdlib|stdnoreturn|string|tgmath|threads|time|uchar|wchar|wctype"
)
"""The headers of the C library."""


def to_c(model: Model, smoothing: float) -> Exported:
    """Return `NAME.h` and `NAME.c` of a model; `smoothing` [rad/s or m/s] is the speed v_s of the smoothed sign.

    Raises InputError where the speed isn't positive, and where the torque of the arm at rest is not defined.
    """
    if not 0 < smoothing < np.inf:
        raise InputError(f"--smoothing {smoothing}: a speed above 0 is needed")
    structure, values, left = _expressible(model)
    name = _identifier(model.robot.name)
    functions = _functions(structure, values, smoothing, name)
    _refuse_undefined(functions[0], structure)
    files = {f"{name}.h": _header(model, name, smoothing), f"{name}.c": _source(functions, name, model.robot.n)}
    notes = (
        f"dry friction is smoothed below {smoothing:g} rad/s (m/s)",
        f"{name}.h declares {name}_torque, {name}_gravity and {name}_friction",
    )
    carried = tuple(label for label in model.structure.labels if label not in left)
    return Exported(files, carried, left, notes)


def _expressible(model: Model) -> tuple[Structure, Array, tuple[str, ...]]:
    """Return the structure without the effects that no expression of the present state gives, and its values."""
    structure, kept = model.structure.with_only(lambda effect: effect.symbolic)
    left = tuple(effect.label for effect in model.structure.effects if not effect.symbolic)
    return structure, model.linear[kept], left


def _refuse_undefined(torque: Any, structure: Structure) -> None:
    """Raise InputError where a model's torque is no number at rest: a controller starts there."""
    limits, rest = structure.robot.limits, np.zeros(structure.robot.n)
    for q in (rest, *np.random.default_rng(0).uniform(-1.0, 1.0, (3, len(rest)))):
        found = np.array(torque(np.clip(q, limits.lower, limits.upper), rest, rest)).ravel()
        if not np.isfinite(found).all():
            joint = structure.robot.joints[int(np.flatnonzero(~np.isfinite(found))[0])]
            of = ", ".join(effect.label for effect in structure.effects if is_own(type(effect)))
            raise InputError(f"the torque of {joint} at rest is not a number ({of or 'its model'}); nothing to export")


def _functions(structure: Structure, values: Array, smoothing: float, name: str) -> list[Any]:
    """Return the CasADi functions of the header, in its order."""
    import casadi as ca

    def sign(v: Any) -> Any:
        x = ca.fmin(ca.fmax(v / smoothing, -1.0), 1.0)
        return 0.5 * x * (3.0 - x * x)

    n, base = structure.robot.n, len(structure.base.columns)
    phi = columns_function(structure, sign, values)
    q, dq, ddq = ca.SX.sym("q", n), ca.SX.sym("dq", n), ca.SX.sym("ddq", n)
    theta, rest = ca.DM(values), ca.DM.zeros(n)
    links = ca.DM(np.concatenate([values[:base], np.zeros(len(values) - base)]))
    whole, at_rest = phi(q, dq, ddq) @ theta, phi(q, rest, rest) @ theta
    rubbing = phi(q, dq, rest) @ theta - phi(q, dq, rest) @ links - (at_rest - phi(q, rest, rest) @ links)
    outputs = {"torque": ([q, dq, ddq], whole), "gravity": ([q], at_rest), "friction": ([q, dq], rubbing)}
    return [
        ca.Function(f"{name}_{word}_casadi", inputs, [ca.densify(ca.cse(tau))])
        for word, (inputs, tau) in outputs.items()
    ]


def _source(functions: list[Any], name: str, n: int) -> str:
    import casadi as ca

    generator = ca.CodeGenerator(f"{name}_generated", {"with_header": False, "main": False, "verbose": False})
    for function in functions:
        generator.add(function)
    kept = {f"{name}_{word}_casadi" for word in _FUNCTIONS}
    generated = _EXPORTED.sub(lambda found: found[0] if found["name"] in kept else "", generator.dump())
    wrappers = []
    for word, function in zip(_FUNCTIONS, functions, strict=True):
        inputs = _FUNCTIONS[word][0].split(", ")
        sizes = max(1, function.sz_arg()), max(1, function.sz_res()), max(1, function.sz_iw()), max(1, function.sz_w())
        lines = [
            f"void {name}_{word}({_signature(inputs, n)}) {{",
            f"  const double *arg[{sizes[0]}] = {{{', '.join(inputs)}}};",
            f"  double *res[{sizes[1]}] = {{tau}};",
            f"  long long int iw[{sizes[2]}];",
            f"  double w[{sizes[3]}];",
            f"  (void){name}_{word}_casadi(arg, res, iw, w, 0);",
            "}",
        ]
        wrappers.append("\n".join(lines))
    generated = _BODY.sub(r"\g<0>  (void)arg; (void)res; (void)iw; (void)w; (void)mem;\n", _SHAPES.sub("", generated))
    generated = re.sub(r"\n{3,}", "\n\n", generated)
    return f'#include "{name}.h"\n\n#define CASADI_SYMBOL_EXPORT static\n\n{generated}\n' + "\n\n".join(wrappers) + "\n"


def _signature(inputs: list[str], n: int) -> str:
    return ", ".join([*(f"const double {word}[{n}]" for word in inputs), f"double tau[{n}]"])


def _header(model: Model, name: str, smoothing: float) -> str:
    n, guard = model.robot.n, f"{name.upper()}_H"
    units = ", ".join(f"{joint} {model.robot.torque_unit(k)}" for k, joint in enumerate(model.robot.joints))
    declared = "\n\n".join(
        f"/* {text[0].upper()}{text[1:]}. */\nvoid {name}_{word}({_signature(inputs.split(', '), n)});"
        for word, (inputs, text) in _FUNCTIONS.items()
    )
    return (
        f"/* {_comment(model.robot.name)}, identified by robot_ident ({model.estimator})."
        f" Joints, in this order: {_comment(units)}.\n"
        "   q [rad or m], dq, ddq [the same per s, per s^2]."
        f" Dry friction is smoothed below {smoothing:g} rad/s (m/s).\n"
        "   Needs no library but the C mathematics, allocates nothing, keeps no state. */\n"
        f'#ifndef {guard}\n#define {guard}\n\n#ifdef __cplusplus\nextern "C" {{\n#endif\n\n'
        f"#define {name.upper()}_JOINTS {n}\n\n{declared}\n\n#ifdef __cplusplus\n}}\n#endif\n\n#endif\n"
    )


def _identifier(text: str) -> str:
    """Return a robot's name as a name in C, of functions and of files: C reserves names that begin with an underscore,
    and C++ those with two in a row; a file that is named as one of the C library would be taken for it.
    """
    word = re.sub("[^a-z0-9]+", "_", text.lower()).strip("_")
    if not word:
        return "robot"
    return f"robot_{word}" if word[0].isdigit() or _TAKEN.fullmatch(word) else word


def _comment(text: str) -> str:
    """Return a text that a comment may hold, which nothing in it ends or begins anew."""
    return one_line(text).replace("*/", "* /").replace("/*", "/ *")

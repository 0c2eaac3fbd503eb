"""How variables and regions of them are written."""

from __future__ import annotations

from robot_ident.workbench.brush import Condition
from robot_ident.workbench.view import View


def in_words(view: View, joint: int, condition: Condition) -> str:
    """Return a condition in words: `0.1 < dq < 0.3 rad/s`."""
    symbol, unit = symbol_of(view, joint, condition.variable)
    source = "" if condition.recording is None else f" of {view.recordings[condition.recording]['name']}"
    return f"{condition.lower:.3g} < {symbol} < {condition.upper:.3g} {unit}{source}"


def symbol_of(view: View, joint: int, variable: str) -> tuple[str, str]:
    """Return the symbol and the unit of a variable."""
    kind, _, other = variable.partition(" of ")
    length = "m" if view.comparison["prismatic"][view.joints.index(other) if other else joint] else "rad"
    of = f" of {other}" if other and other != view.joints[joint] else ""
    return {
        "time": ("t", "s"),
        "position": (f"q{of}", length),
        "velocity": (f"dq{of}", f"{length}/s"),
        "speed": (f"|dq{of}|", f"{length}/s"),
        "acceleration": (f"ddq{of}", f"{length}/s²"),
        "load": (f"load torque{of}", view.unit(joint)),
        "time_since_reversal": (f"time since reversal{of}", "s"),
    }[kind]

"""What a residual depends on when no known effect explains it: smooth curves over one variable, judged on another
trajectory.
"""

from __future__ import annotations

import numpy as np

from robot_ident.diagnosis.diagnosis import Unexplained
from robot_ident.diagnosis.evidence import Evidence
from robot_ident.motion import Array, Mask

_KNOTS = 12


def explain_by_variables(evidence: Evidence, joint: int) -> Unexplained:
    """Return which variable predicts a joint's residual on trajectories left out, and where along it the error sits."""
    names = evidence.structure.robot.joints
    variables = _variables(evidence)
    residual = [r[:, joint] for r in evidence.residual]
    used = [t.weight[:, joint] > 0 for t in evidence.trajectories]
    dof = float(sum(t.dof[joint] for t in evidence.trajectories))
    excess = max(sum(float(np.sum(r**2)) for r in residual) - dof, 1e-12)
    shares = {}
    for name, values in variables.items():
        shares[name] = float(np.clip(_held_out(values, residual, used) / excess, 0.0, 1.0))
    own = {
        "position": shares[f"position of {names[joint]}"],
        "velocity": shares[f"velocity of {names[joint]}"],
        "acceleration": shares[f"acceleration of {names[joint]}"],
        "load": shares[f"load of {names[joint]}"],
    }
    others = {k: v for k, v in shares.items() if not k.endswith(f" of {names[joint]}") and v > 0.02}
    best = max(shares, key=lambda key: shares[key])
    return Unexplained(names[joint], {**own, **others}, _where(best, variables[best], residual, used))


def _variables(evidence: Evidence) -> dict[str, list[Array]]:
    out: dict[str, list[Array]] = {}
    torques = [evidence.structure.torques(t.motion, evidence.values) for t in evidence.trajectories]
    for j, name in enumerate(evidence.structure.robot.joints):
        rows = [t.measured.rows for t in evidence.trajectories]
        motions = [t.motion for t in evidence.trajectories]
        out[f"position of {name}"] = [m.q[r, j] for m, r in zip(motions, rows, strict=True)]
        out[f"velocity of {name}"] = [m.dq[r, j] for m, r in zip(motions, rows, strict=True)]
        out[f"acceleration of {name}"] = [m.ddq[r, j] for m, r in zip(motions, rows, strict=True)]
        out[f"load of {name}"] = [x.load[r, j] for x, r in zip(torques, rows, strict=True)]
    return out


def _hats(values: Array, knots: Array) -> Array:
    """Return piecewise linear basis functions [N, knots]."""
    return np.column_stack([np.interp(values, knots, row) for row in np.eye(len(knots))])


def _knots(values: list[Array], used: list[Mask]) -> Array:
    joined = np.concatenate([v[u] for v, u in zip(values, used, strict=True)])
    return np.unique(np.quantile(joined, np.linspace(0.0, 1.0, _KNOTS)))


def _held_out(values: list[Array], residual: list[Array], used: list[Mask]) -> float:
    """Return the fall of the squared error on trajectories left out, by a curve fitted to the others."""
    knots = _knots(values, used)
    if len(knots) < 3:
        return 0.0
    fall = 0.0
    for left in range(len(values)):
        train = [k for k in range(len(values)) if k != left] or [left]
        a = np.concatenate([_hats(values[k][used[k]], knots) for k in train])
        b = np.concatenate([residual[k][used[k]] for k in train])
        curve = np.linalg.lstsq(a, b, rcond=1e-8)[0]
        r = residual[left][used[left]]
        fall += float(np.sum(r**2) - np.sum((r - _hats(values[left][used[left]], knots) @ curve) ** 2))
    return fall


def _where(name: str, values: list[Array], residual: list[Array], used: list[Mask]) -> str:
    """Return the stretch of a variable on which the excess is densest, in words."""
    joined = np.concatenate([v[u] for v, u in zip(values, used, strict=True)])
    squared = np.concatenate([r[u] ** 2 for r, u in zip(residual, used, strict=True)]) - 1.0
    edges = np.unique(np.quantile(joined, np.linspace(0.0, 1.0, 11)))
    if len(edges) < 3:
        return f"over {name}"
    place = np.clip(np.searchsorted(edges, joined, side="right") - 1, 0, len(edges) - 2)
    power = np.array([squared[place == k].sum() for k in range(len(edges) - 1)])
    best = int(np.argmax(power))
    share = power[best] / max(power[power > 0].sum(), 1e-12)
    return f"{name} from {edges[best]:.3g} to {edges[best + 1]:.3g}: {100 * share:.0f} % of the excess"

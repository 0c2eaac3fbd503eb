"""What every kind of `robot_ident design` prints with --json."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from robot_ident.design.criteria import Evaluation
    from robot_ident.design.design import DesignResult
    from robot_ident.limits.certifier import Margins


def design_json(
    files: Sequence[str],
    values: Evaluation | DesignResult,
    parameters: Sequence[str],
    margins: Margins,
    seconds: float,
    notes: Sequence[str],
    **kind: Any,
) -> dict[str, Any]:
    """Return the keys of all kinds; `kind` are those that one kind of design fills, null (empty) in the others."""
    own: dict[str, Any] = {"tell": None, "bound": None, "page": None, "held": {}, "waypoints": None, "precision": None}
    own |= dict.fromkeys(("validation", "iterations"))
    assert kind.keys() <= own.keys()
    return {
        "schema": "robot_ident/design/1",
        "files": list(files),
        "log10_det_covariance": values.log10_det_covariance,
        "condition_number": values.condition_number,
        "seconds": seconds,
        "margins": margins.to_json(),
        "not_checked": list(margins.unknown),
        "sigma": dict(zip(parameters, values.sigma.tolist(), strict=True)),
        "notes": list(notes),
        **own,
        **kind,
    }

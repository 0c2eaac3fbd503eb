"""What the kinds of `robot_ident design` share: refusing the options of the others, and what --json prints."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from robot_ident.errors import InputError

if TYPE_CHECKING:
    from robot_ident.design.criteria import Evaluation
    from robot_ident.design.design import DesignResult
    from robot_ident.limits.certifier import Margins


def refuse_with(args: argparse.Namespace, kind: str, options: Sequence[str]) -> None:
    """Raise InputError where options are given that a kind of design (its option) would not heed."""
    given = [option for option in options if _is_given(args, option)]
    if given:
        raise InputError(f"{kind} does not go with {', '.join(given)}")


def _is_given(args: argparse.Namespace, option: str) -> bool:
    if option == "--trajectories":
        return bool(args.trajectories > 1)
    name = "run_before" if option == "--from" else option.lstrip("-").replace("-", "_")
    return bool(getattr(args, name))


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

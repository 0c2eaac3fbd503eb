"""What the tests of diagnosis share: where cases are kept, how many there are, and how rates are printed."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

CASES = int(os.environ.get("ROBOT_IDENT_TRIAL_CASES", "300"))
"""Cases of a row; rows of each larger arm have half of them."""

FOLDER = Path(os.environ.get("ROBOT_IDENT_ACCEPTANCE", "build/acceptance"))
"""Where motions and finished cases are kept: what was stopped goes on from there."""

FIRST_SEED = int(os.environ.get("ROBOT_IDENT_FIRST_SEED", "11000"))
"""No development has used seeds from here on."""


def print_rates(title: str, data: dict[str, Any]) -> None:
    """Print a summary of outcomes."""
    print(f"\n{title}")
    for rate in data["rates"]:
        low, high, count = 100 * rate["lower"], 100 * rate["upper"], rate["cases"]
        print(f"  {rate['name']:<30} {100 * rate['share']:5.1f} %  ({low:.1f} to {high:.1f} %, {count} cases)")
    removed = data["error_removed"]
    if removed:
        median, tenth = 100 * removed["median"], 100 * removed["tenth_percentile"]
        print(f"  error removed on unseen motion: median {median:.1f} %, 10th percentile {tenth:.1f} %")
    seconds = data["diagnosis_seconds"]
    print(f"  one diagnosis: median {seconds['median']:.1f} s of processor time, at most {seconds['largest']:.1f} s")
    for name, row in data["confusion"].items():
        print(f"  {name}: " + ", ".join(f"{said} {count}" for said, count in row.items()))


def rate_of(data: dict[str, Any], name: str) -> dict[str, Any]:
    """Return one of the rates of a summary."""
    return next(rate for rate in data["rates"] if rate["name"] == name)

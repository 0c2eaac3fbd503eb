"""Faults of measuring hidden: friction is hardly ever blamed for them, on seeds that no development has used."""

from __future__ import annotations

import json
from contextlib import redirect_stdout
from functools import cache
from typing import Any

from table import CASES, FIRST_SEED, FOLDER, print_rates, rate_of

from robot_ident.cli.main import main


@cache
def trial() -> dict[str, Any]:
    """Return what `robot_ident trial --family measurement --json` prints."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    out = FOLDER / "kuka_ir361_measurement.json"
    words = ["trial", "--family", "measurement", "--seeds", f"{FIRST_SEED}:{FIRST_SEED + CASES}"]
    words += ["--folder", str(FOLDER), "--cases-file", str(out.with_suffix(".jsonl")), "--json"]
    with out.open("w", encoding="utf-8") as file, redirect_stdout(file):
        code = main(words)
    assert code == 0
    data: dict[str, Any] = json.loads(out.read_text(encoding="utf-8"))
    print_rates(f"faults of measuring, {CASES} seeds", data)
    return data


def test_friction_is_not_blamed_for_measuring() -> None:
    rate = rate_of(trial(), "friction_named_for_fault")
    assert rate["lower"] <= 0.01, rate


def test_gains_and_loads_are_named() -> None:
    """Filters may pass for delays, and errors of a link's length hide below the noise: neither is counted here."""
    cases = [c for c in trial()["cases"] if c["truth"][0].partition("@")[0] in ("effort_gain", "payload")]
    right = sum(c["named"] == c["truth"] for c in cases)
    assert right >= 0.9 * len(cases), [c["seed"] for c in cases if c["named"] != c["truth"]]

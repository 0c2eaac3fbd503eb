"""Trials by the command line, each run once."""

from __future__ import annotations

import json
from contextlib import redirect_stdout
from functools import cache
from typing import Any

from table import CASES, FIRST_SEED, FOLDER, print_rates

from robot_ident.cli.main import main


@cache
def trial(kind: str, noise: float = 1.0, robot: str = "kuka_ir361", cases: int = CASES) -> dict[str, Any]:
    """Return what `robot_ident trial --json` prints of a kind of cases."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    name = f"{robot.rpartition('/')[2]}_{kind}_{noise:g}"
    out = FOLDER / f"{name}.json"
    words = ["trial", "--robot", robot, "--kind", kind, "--noise", str(noise)]
    words += ["--seeds", f"{FIRST_SEED}:{FIRST_SEED + cases}", "--folder", str(FOLDER)]
    with out.open("w", encoding="utf-8") as file, redirect_stdout(file):
        code = main([*words, "--cases-file", str(FOLDER / f"{name}.jsonl"), "--json"])
    assert code == 0
    data: dict[str, Any] = json.loads(out.read_text(encoding="utf-8"))
    print_rates(f"{name} of {cases} seeds", data)
    return data

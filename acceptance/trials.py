"""Trials by the command line, and cases of simulators that are not the product's; each is run once."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from contextlib import redirect_stdout
from functools import cache
from typing import Any

from table import CASES, FIRST_SEED, FOLDER, print_rates

from robot_ident.cli.main import main
from robot_ident.parallel import completed
from robot_ident.testbed.trial import Outcome
from robot_ident.testbed.trial_table import summary


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


def judged(name: str, run: Callable[[int], Outcome], seeds: Sequence[int], least: float) -> dict[str, Any]:
    """Return the summary of the cases of a name; finished ones are read from the folder."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    journal = FOLDER / f"{name}.jsonl"
    lines = journal.read_text(encoding="utf-8").splitlines() if journal.exists() else []
    done = {outcome.seed: outcome for outcome in (Outcome.of_dict(json.loads(line)) for line in lines)}
    with journal.open("a", encoding="utf-8") as file:
        for _, outcome in completed(run, [seed for seed in seeds if seed not in done]):
            done[outcome.seed] = outcome
            file.write(json.dumps(outcome.to_dict()) + "\n")
            file.flush()
    return summary([done[seed] for seed in seeds], least)

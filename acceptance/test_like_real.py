"""Simulated recordings with the faults of real ones: the base model chosen beside a grid of fixed filters."""

from __future__ import annotations

import json
import os
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any

import pytest
import yaml
from arms import write_arm

from robot_ident.cli.main import main

CASES = int(os.environ.get("ROBOT_IDENT_LIKE_REAL", "99"))
FIRST = 6304
"""Judged once with these; development has used those before."""


def arms(folder: Path) -> list[str]:
    out = ["kuka_ir361"]
    for name in ("ur5", "panda"):
        path = write_arm(name, folder)
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
        del content["effects"]  # nobody has told of rotors
        path.write_text(yaml.safe_dump(content), encoding="utf-8")
        out.append(str(path))
    return out


def test_the_choice_beside_fixed_filters(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    each = CASES // 3
    found: list[dict[str, Any]] = []
    for k, robot in enumerate(arms(tmp_path)):
        seeds = f"{FIRST + k * each}:{FIRST + (k + 1) * each}"
        out = tmp_path / f"{k}.json"
        with out.open("w", encoding="utf-8") as file, redirect_stdout(file):
            assert main(["trial", "--family", "real", "--robot", robot, "--seeds", seeds, "--json"]) == 0
        found.append(json.loads(out.read_text(encoding="utf-8")))
    with capsys.disabled():
        for one in found:
            print(f"\n{Path(one['robot']).stem}:")
            for row in (*one["kinds"], *one["rates"]):
                print("  " + ", ".join(f"{key} {value}" for key, value in row.items()))
    for kind in ("one pass", "periodic", "cyclic"):
        rows = [row for one in found for row in one["kinds"] if row["kind"] == kind]
        assert sum(row["as_good"] for row in rows) >= 0.9 * sum(row["cases"] for row in rows), kind

    def share(name: str) -> float:
        rows = [row for one in found for row in one["rates"] if row["name"] == name]
        return float(sum(row["successes"] for row in rows) / max(1, sum(row["cases"] for row in rows)))

    assert share("scales within two sigma") >= 0.9
    assert share("scales invented where there are none") <= 0.05

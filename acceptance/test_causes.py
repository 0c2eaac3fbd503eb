"""Recordings like real ones with several causes on every joint: names, what they buy, and how sure they are."""

from __future__ import annotations

import json
import os
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any

import pytest
from test_like_real import arms

from robot_ident.cli.main import main

CASES = int(os.environ.get("ROBOT_IDENT_CAUSES", "60"))
FIRST = int(os.environ.get("ROBOT_IDENT_CAUSES_FIRST", "7100"))
"""No development has used seeds from 7100 on."""


def test_names_of_several_causes_on_every_joint(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    each = CASES // 3
    found: list[dict[str, Any]] = []
    for k, robot in enumerate(arms(tmp_path)):
        out = tmp_path / f"{k}.json"
        words = ["trial", "--family", "real", "--kind", "effects", "--robot", robot, "--json"]
        seeds = ["--seeds", f"{FIRST + k * each}:{FIRST + (k + 1) * each}"]
        with out.open("w", encoding="utf-8") as file, redirect_stdout(file):
            assert main([*words, *seeds]) == 0
        found.append(json.loads(out.read_text(encoding="utf-8")))
    with capsys.disabled():
        for one in found:
            print(f"\n{Path(one['robot']).stem}: error removed {one['error_removed']}, {one['seconds']:.1f} s")
            for row in (*one["rates"], *one["reliability"]):
                print("  " + ", ".join(f"{key} {value}" for key, value in row.items() if key != "exceptions"))

    def share(name: str) -> float:
        rows = [row for one in found for row in one["rates"] if row["name"].startswith(name) and row["kind"] == "all"]
        return float(sum(row["successes"] for row in rows) / max(1, sum(row["cases"] for row in rows)))

    assert share("names that are right, or tied with one that is") >= 0.95
    assert share("causes of") >= 0.8
    assert share("joints without") == 0.0

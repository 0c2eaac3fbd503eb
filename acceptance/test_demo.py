"""`make demo`, twenty times in a row with other seeds: none fails, none names what isn't there.

A demo fails that ends with an error, selects nothing of what is hidden or anything else, whose residual does not begin
at two to three times the noise of every joint, or whose last model leaves more than noise where it has all effects. How
many select all that is hidden is printed.

ROBOT_IDENT_DEMOS: how many times (20), or which seeds (5:20). ROBOT_IDENT_DEMOS_KEPT: a folder for the answer of each
demo and for all its files where it failed; demos that are done there already are not run again.
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rclpy")

FIRST, _, LAST = os.environ.get("ROBOT_IDENT_DEMOS", "20").rpartition(":")
SEEDS = range(int(FIRST or 0), int(LAST))
KEPT = os.environ.get("ROBOT_IDENT_DEMOS_KEPT", "")
LIMIT = 7200.0  # s; a demo says itself when nothing moves on, long before


def demo(seed: int, folder: Path) -> dict[str, Any]:
    """Run one demo; return what it told, or `failure` with the last line of its log, which stays in the folder."""
    folder.mkdir(parents=True)
    command = [sys.executable, "-m", "robot_ident", "demo", "--json", "--folder", folder / "demo", "--seed", str(seed)]
    with (folder / "log.txt").open("w") as log, (folder / "told.json").open("w") as told:
        process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=told, stderr=log)
        try:
            code = process.wait(LIMIT)
            failure = f"code {code}" if code else ""
        except subprocess.TimeoutExpired:
            process.send_signal(signal.SIGINT)  # it ends its nodes itself
            process.wait()
            failure = f"not done within {LIMIT:g} s"
    said = [line for line in (folder / "log.txt").read_text(errors="replace").splitlines() if line.strip()]
    if failure:
        return {"failure": f"{failure}: {(said or ['silent'])[-1]}; its log: {folder / 'log.txt'}"}
    answer: dict[str, Any] = json.loads((folder / "told.json").read_text())
    return answer


def named(told: dict[str, Any]) -> set[str]:
    """Return the effects that a demo selected: those of its last model that the paper's model lacks."""
    first, last = told["models"][0], told["models"][-1]
    return set(last["effects"]) - set(first["effects"])


def ratios(model: dict[str, Any]) -> dict[str, float]:
    """Return residual over noise of a model by joint, rows at reversals included, on the fitted recordings."""
    return {joint: (fit["mse"] / fit["noise_variance"]) ** 0.5 for joint, fit in model["residual"].items()}


def judged(told: dict[str, Any], hidden: set[str]) -> str:
    """Return what is wrong with a demo, or an empty text."""
    if "failure" in told:
        return str(told["failure"])
    found = named(told)
    if not found or found - hidden:
        return f"hidden: {', '.join(sorted(hidden))}; selected: {', '.join(sorted(found)) or 'nothing'}"
    first, last = ratios(told["models"][0]), ratios(told["models"][-1])
    if not all(2.0 <= ratio <= 3.0 for ratio in first.values()):
        return f"residual / noise at first: {first}"
    if found == hidden and not all(ratio <= 1.25 for ratio in last.values()):
        return f"residual / noise with all effects: {last}"
    return "" if Path(told["report"]).stat().st_size > 100_000 else "its report is empty"


def test_unattended(tmp_path: Path) -> None:
    from robot_ident.cli.demo import HIDDEN

    hidden = {effect.partition(":")[0] for effect in HIDDEN}
    kept = Path(KEPT) if KEPT else tmp_path
    seconds, whole, failed = [], 0, {}
    for seed in SEEDS:
        folder = kept / f"demo_{seed}"
        done = folder / "done.json"
        if not done.is_file():
            shutil.rmtree(folder, ignore_errors=True)
            told = demo(seed, folder)
            problem = judged(told, hidden)
            if problem:
                failed[seed] = problem
                print(f"  demo {seed:2d}: {problem}", flush=True)
                continue
            done.write_text(json.dumps({"seconds": told["seconds"], "found": sorted(named(told))}))
            shutil.rmtree(folder / "demo")
        told = json.loads(done.read_text())
        seconds.append(told["seconds"])
        whole += set(told["found"]) == hidden
        print(f"  demo {seed:2d}: {told['seconds']:5.0f} s, found {', '.join(told['found'])}", flush=True)
    if seconds:
        print(f"{len(seconds)} of {len(SEEDS)} demos, {whole} of which selected all that is hidden")
        print(f"  median {np.median(seconds):.0f} s, longest {max(seconds):.0f} s")
    assert not failed, "\n".join(f"demo {seed}: {problem}" for seed, problem in failed.items())

"""What a second simulator hides, whose formulas, servo and noise are its own, found by the same diagnosis."""

from __future__ import annotations

import json
import time
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from foreign.cases import ForeignCase, make_case
from table import CASES, FIRST_SEED, FOLDER, print_rates, rate_of
from trials import trial

from robot_ident.diagnosis.diagnose import diagnose
from robot_ident.diagnosis.score import summary
from robot_ident.diagnosis.trial import Outcome
from robot_ident.estimation.identify import estimate
from robot_ident.model.structure import Structure
from robot_ident.parallel import completed
from robot_ident.recording import Recording, process
from robot_ident.recording.measurement import Measurement
from robot_ident.robot import load_robot

KINDS = {"known": "single", "unknown": "unknown", "null": "null"}
LEAST = 1.0  # Nm rms that an effect has to leave to be counted


def run_case(seed: int, kind: str, files: list[Path]) -> Outcome:
    """Hide, record, diagnose, add: the last motion is unseen by any fit, and without noise."""
    robot = load_robot("kuka_ir361")
    structure = Structure.build(robot)
    motions = [yaml.safe_load(file.read_text(encoding="utf-8")) for file in files]
    case = make_case(seed, kind, motions, clean=1)
    *training, unseen = (process(Recording(robot.joints, *data), robot) for data in case.recordings)
    started = time.process_time()
    found = diagnose(training, structure)
    seconds = time.process_time() - started
    names = tuple(s.label for s in found.missing)
    before = after = None
    if found.missing and kind == "known":
        longer = Structure.build(robot, [suspect.effect for suspect in found.missing])
        before, after = (_errors(training, s, unseen) for s in (structure, longer))
    return Outcome(
        seed=seed,
        kind=KINDS[kind],
        hidden=(case.what,),
        truth=(case.truth,) if case.truth else (),
        background=(),
        visible=_visible(case),
        verdict=found.verdict,
        named=names,
        tied=tuple(s.tied_with for s in found.missing),
        explained=tuple(s.explained for s in found.missing),
        others=tuple(s.label for s in found.others),
        remaining_rms=dict(found.remaining_rms),
        error_before=before,
        error_after=after,
        seconds=seconds,
    )


def _visible(case: ForeignCase) -> dict[str, float]:
    return {f"joint_{k}": float(x) for k, x in enumerate(case.visible, 1)}


def _errors(training: list[Measurement], structure: Structure, unseen: Measurement) -> dict[str, float]:
    model = estimate(training, structure)
    rows = (unseen.used & ~unseen.standstill).all(axis=1)
    mean = np.mean((unseen.torque - model.predict(unseen.motion))[rows] ** 2, axis=0)
    return dict(zip(structure.robot.joints, mean.tolist(), strict=True))


@cache
def outcomes(kind: str, cases: int) -> dict[str, Any]:
    """Return the summary of all cases of a kind; finished ones are read from the folder."""
    trial("null", cases=1)  # designs the motions where there are none yet
    files = sorted(FOLDER.glob("kuka_ir361_[1-4].yaml"))
    journal = FOLDER / f"foreign_{kind}.jsonl"
    lines = journal.read_text(encoding="utf-8").splitlines() if journal.exists() else []
    done = {outcome.seed: outcome for outcome in (Outcome.of_dict(json.loads(line)) for line in lines)}
    seeds = [seed for seed in range(FIRST_SEED, FIRST_SEED + cases) if seed not in done]
    with journal.open("a", encoding="utf-8") as file:
        for _, outcome in completed(partial(run_case, kind=kind, files=files), seeds):
            done[outcome.seed] = outcome
            file.write(json.dumps(outcome.to_dict()) + "\n")
            file.flush()
    data = summary([done[seed] for seed in range(FIRST_SEED, FIRST_SEED + cases)], LEAST)
    print_rates(f"second simulator, {kind}", data)
    return data


def test_named_right() -> None:
    """Formulas that are not the catalogue's: as often as promised, within the interval that the cases leave."""
    rate = rate_of(outcomes("known", CASES), "named_right")
    assert rate["upper"] >= 0.95, rate


def test_truth_in_the_tie_group() -> None:
    rate = rate_of(outcomes("known", CASES), "truth_in_tie_group")
    assert rate["upper"] >= 0.99, rate


def test_adding_removes_the_error() -> None:
    removed = outcomes("known", CASES)["error_removed"]
    assert removed["median"] >= 0.95
    assert removed["tenth_percentile"] >= 0.80


@pytest.mark.parametrize(
    ("kind", "name", "most"), [("unknown", "unknown_named", 0.01), ("null", "false_name_on_null", 0.005)]
)
def test_no_name_without_a_cause(kind: str, name: str, most: float) -> None:
    rate = rate_of(outcomes(kind, CASES // 2), name)
    assert rate["lower"] <= most, rate

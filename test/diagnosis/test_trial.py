"""Scores of a trial: counted as said, with intervals that hold what they promise."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from robot_ident.testbed.scenario import draw_scenario, seal
from robot_ident.testbed.trial import MEASUREMENT, Case, Outcome, Setting, run_case
from robot_ident.testbed.trial_table import confusion, rates, removed_quantiles, wilson
from robot_ident.trajectories.excitation import Excitation

Verb = Callable[..., tuple[int, str, str]]

RIGHT = Outcome(
    seed=1,
    kind="single",
    hidden=("stribeck@joint_2:stribeck=20.0",),
    truth=("stribeck@joint_2",),
    background=(),
    visible={"joint_1": 0.1, "joint_2": 3.0},
    verdict="missing",
    named=("stribeck@joint_2",),
    tied=((),),
    explained=(0.9,),
    others=(),
    remaining_rms={"joint_1": 0.0, "joint_2": 0.1},
    error_before={"joint_1": 0.0, "joint_2": 10.0},
    error_after={"joint_1": 0.0, "joint_2": 1.0},
    scale={"joint_1": 2.0, "joint_2": 10.0},
    seconds=1.0,
)
TIED = replace(RIGHT, seed=2, named=("cable@joint_2",), tied=(("stribeck@joint_2",),))
WRONG = replace(RIGHT, seed=3, named=("stribeck@joint_1",), error_before=None, error_after=None)
MORE = replace(RIGHT, seed=4, named=("stribeck@joint_2", "cable@joint_1"), tied=((), ()))
SILENT = replace(RIGHT, seed=5, verdict="adequate", named=(), tied=(), error_before=None, error_after=None)
SMALL = replace(WRONG, seed=6, visible={"joint_1": 0.0, "joint_2": 0.5})
NULL = replace(RIGHT, seed=7, kind="null", truth=(), named=(), tied=(), visible={"joint_1": 0.0})
STRANGE = replace(RIGHT, seed=8, kind="unknown", truth=("unknown_bump@joint_1",))


def test_wilson_interval() -> None:
    assert wilson(0, 0) == (0.0, 1.0)
    assert wilson(8, 10) == pytest.approx((0.4901625, 0.9433178), abs=1e-6)
    assert wilson(0, 400)[0] == 0.0
    assert wilson(0, 400)[1] == pytest.approx(0.0095, abs=1e-4)
    rng, p = np.random.default_rng(0), 0.95
    covered = [low <= p <= high for low, high in (wilson(int(k), 60) for k in rng.binomial(60, p, 2000))]
    assert 0.92 < np.mean(covered) < 0.985


def test_rates_count_what_they_say() -> None:
    found = {r.name: r for r in rates([RIGHT, TIED, WRONG, MORE, SILENT, SMALL, NULL, STRANGE], least=1.0)}
    assert (found["named_right"].successes, found["named_right"].cases) == (1, 5)
    assert found["named_right"].exceptions == (2, 3, 4, 5)
    assert (found["truth_in_tie_group"].successes, found["truth_in_tie_group"].exceptions) == (3, (3, 5))
    assert (found["wrong_name_outside_tie"].successes, found["wrong_name_outside_tie"].exceptions) == (2, (3, 4))
    assert (found["false_name_on_null"].successes, found["false_name_on_null"].cases) == (0, 1)
    assert (found["unknown_named"].successes, found["unknown_named"].exceptions) == (1, (8,))
    assert "pair_found_nothing_else" not in found


def test_pairs_and_background() -> None:
    pair = replace(RIGHT, kind="pair_other_joints", truth=("stribeck@joint_2", "cable@joint_1"))
    both = replace(pair, named=("cable@joint_1", "stribeck@joint_2"), tied=((), ()))
    behind = replace(RIGHT, kind="single_with_background", background=("cable@joint_1",))
    also = replace(behind, named=MORE.named, tied=MORE.tied)
    stranger = replace(behind, named=("stribeck@joint_2", "cable@joint_3"), tied=((), ()))
    like_it = replace(behind, named=("stribeck@joint_2", "end_stop@joint_1"), tied=((), ("cable@joint_1",)))
    found = {r.name: r for r in rates([pair, both, behind, also, stranger, like_it], least=1.0)}
    assert (found["pair_found_nothing_else"].successes, found["pair_found_nothing_else"].cases) == (1, 2)
    assert (found["named_right_with_background"].successes, found["named_right_with_background"].cases) == (3, 4)


def test_several_effects_are_found_or_indistinguishable() -> None:
    both = ("cable@joint_2", "stribeck@joint_2")
    found_both = replace(RIGHT, kind="same_joint", truth=both, named=both, tied=((), ()))
    one_set = replace(found_both, seed=2, named=(), tied=(), tied_sets=(("end_stop@joint_2",), both))
    half = replace(found_both, seed=3, named=both[:1], tied=((),))
    stranger = replace(found_both, seed=4, named=(*both, "backlash@joint_1"), tied=((), (), ()))
    none = replace(found_both, seed=5, named=(), tied=(), verdict="unexplained")
    found = {r.name: r for r in rates([found_both, one_set, half, stranger, none], least=1.0)}
    assert (found["same_joint_found_or_tied"].successes, found["same_joint_found_or_tied"].exceptions) == (2, (3, 4, 5))
    assert (found["wrong_name_among_several"].successes, found["wrong_name_among_several"].exceptions) == (1, (4,))
    assert (found["unexplained_though_known"].successes, found["unexplained_though_known"].exceptions) == (1, (5,))


def test_a_fault_counts_as_found_only_where_it_shows() -> None:
    found_one = replace(RIGHT, kind=MEASUREMENT, truth=("effort_gain@joint_2",), named=("effort_gain@joint_2",))
    rubs = replace(found_one, seed=2, named=("stribeck@joint_2",))
    faint = replace(found_one, seed=3, truth=("link_length@joint_2",), named=(), tied=(), visible={"joint_1": 0.1})
    invented = replace(faint, seed=4, named=("stribeck@joint_2",), tied=((),))
    seen = replace(faint, seed=5, named=faint.truth, tied=((),))
    found = {r.name: r for r in rates([found_one, rubs, faint, invented, seen], least=1.0)}
    assert (found["fault_named"].successes, found["fault_named"].exceptions) == (1, (2,))
    wrong = found["wrong_name_for_faint_fault"]
    assert (wrong.successes, wrong.cases, wrong.exceptions) == (1, 3, (4,))
    assert (found["friction_named_for_fault"].successes, found["friction_named_for_fault"].exceptions) == (2, (2, 4))


def test_errors_of_unlike_joints_count_in_units_of_their_noise() -> None:
    made = replace(RIGHT, error_before={"joint_1": 4.0, "joint_2": 100.0}, error_after={"joint_1": 4.0, "joint_2": 0.0})
    assert made.removed == pytest.approx(0.5)


def test_nothing_added_removes_nothing() -> None:
    median, tenth = removed_quantiles([RIGHT] * 9 + [SILENT]) or (0.0, 0.0)
    assert median == pytest.approx(0.9)
    assert tenth < 0.9
    assert removed_quantiles([NULL]) is None


def test_confusion_names_the_joint_only_where_it_is_wrong() -> None:
    table = confusion([RIGHT, WRONG, SILENT, NULL])
    assert table == {"stribeck": {"stribeck": 1, "stribeck elsewhere": 1, "nothing": 1}, "nothing": {"nothing": 1}}


def test_an_outcome_survives_its_file() -> None:
    assert Outcome.of_dict(json.loads(json.dumps(MORE.to_dict()))) == MORE


def test_a_case_hides_names_and_adds(bench: Any) -> None:
    """A whole case: what was drawn is what is reported, and the error is measured on a motion that no fit has seen."""
    setting = Setting(bench.robot, tuple(bench.motions[:2]), bench.motions[3], periods=6, noise=0.1)
    made = run_case(Case(2, "null"), setting)
    assert (made.kind, made.truth, made.named, made.verdict) == ("null", (), (), "adequate")
    assert made.error_before is None


@pytest.fixture
def excitations(bench: Any, tmp_path: Path) -> list[Path]:
    files = [tmp_path / f"x{k}.yaml" for k in range(3)]
    for file, series in zip(files, bench.motions, strict=False):
        Excitation(bench.robot.name, bench.robot.joints, series, 150.0).write(file)
    return files


def test_a_stopped_trial_goes_on(verb: Verb, excitations: list[Path], tmp_path: Path) -> None:
    """The second run does one case, not two; another noise is refused."""
    cases = tmp_path / "cases.jsonl"
    common = ["trial", "--excitation", *excitations, "--kind", "null", "--periods", "4", "--workers", "1", "--json"]
    code, out, err = verb(*common, "--seeds", "0:1", "--cases-file", cases)
    assert code == 0, err
    kept = cases.read_text()
    cases.write_text(kept + '{"seed": 9, "kin')  # killed while it wrote
    code, out, err = verb(*common, "--seeds", "0:2", "--cases-file", cases)
    assert code == 0, err
    assert cases.read_text().startswith(kept)
    assert len(cases.read_text().splitlines()) == 3
    data = json.loads(out)
    assert data["schema"] == "robot_ident/trial/1"
    assert [case["seed"] for case in data["cases"]] == [0, 1]
    (rate,) = data["rates"]
    assert (rate["name"], rate["cases"]) == ("false_name_on_null", 2)
    code, out, err = verb(*common, "--seeds", "0:2", "--cases-file", cases, "--noise", "0.5")
    assert code == 2
    assert "noise" in err and "give another file" in err


def test_a_sealed_answer_is_opened(verb: Verb, bench: Any, tmp_path: Path) -> None:
    scenario = draw_scenario(3, bench.robot, kinds=["single"], names=["torque_offset"])
    path = tmp_path / "bag.sealed"
    path.write_text(seal(scenario))
    code, out, _ = verb("trial", "--open", path)
    assert code == 0
    (effect,) = scenario.effects
    name, _, value = effect.partition("=")
    assert f"  {name.replace(':', ': ')} {float(value):.4g} Nm\n" in out
    code, out, _ = verb("trial", "--open", path, "--json")
    assert json.loads(out)["effects"] == list(scenario.effects)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--seeds", "5"], "A:B"),
        (["--seeds", "5:2"], "A:B"),
        (["--kind", "singel"], "did you mean 'single'"),
        (["--noise", "0"], "--noise"),
        (["--periods", "1"], "--periods 1"),
        (["--workers", "0"], "--workers 0"),
        (["--robot", "kuka"], "kuka"),
        (["--excitation", "x.yaml"], "two files or more"),
        (["--open", "nothing.sealed"], "no such file"),
    ],
)
def test_bad_wishes(verb: Verb, words: list[str], said: str) -> None:
    code, out, err = verb("trial", *words)
    assert code == 2
    assert said in err
    assert len(err.splitlines()) == 1
    assert out == ""

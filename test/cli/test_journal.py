"""The file of finished cases loses nothing: neither what it holds, nor another file that is given by mistake."""

from __future__ import annotations

import json
import os
from dataclasses import replace
from pathlib import Path

import pytest

from robot_ident.cli.journal import SCHEMA, Journal
from robot_ident.errors import InputError
from robot_ident.testbed.trial import Case, Outcome

SETTINGS = {"schema": SCHEMA, "robot": "kuka_ir361", "noise": 1.0}
OUTCOME = Outcome(
    seed=1,
    kind="single",
    hidden=("cable@joint_1:cable=3.0",),
    truth=("cable@joint_1",),
    background=(),
    visible={"joint_1": 2.0},
    verdict="missing",
    named=("cable@joint_1",),
    tied=(("end_stop@joint_1",),),
    explained=(0.9,),
    others=(),
    remaining_rms={"joint_1": 0.0},
    error_before={"joint_1": 4.0},
    error_after={"joint_1": 0.1},
    scale={"joint_1": 20.0},
    seconds=1.5,
)


def test_what_was_kept_is_read_again(tmp_path: Path) -> None:
    path = str(tmp_path / "cases")
    journal = Journal.open(path, SETTINGS, Outcome.of_dict)
    journal.add(Case(1, "single"), OUTCOME)
    journal.add(Case(2), replace(OUTCOME, seed=2, error_before=None, error_after=None))
    again = Journal.open(path, SETTINGS, Outcome.of_dict)
    assert again.outcomes == journal.outcomes
    assert again.outcomes[Case(1, "single")] == OUTCOME


@pytest.mark.parametrize("start", ["", json.dumps(SETTINGS)[:20]])
def test_a_header_that_was_torn_off_is_written_anew(tmp_path: Path, start: str) -> None:
    """As a full disk leaves it."""
    path = tmp_path / "cases"
    path.write_text(start)
    Journal.open(str(path), SETTINGS, Outcome.of_dict).add(Case(1, "single"), OUTCOME)
    assert Journal.open(str(path), SETTINGS, Outcome.of_dict).outcomes == {Case(1, "single"): OUTCOME}


def test_a_torn_case_is_taken_off(tmp_path: Path) -> None:
    path = tmp_path / "cases"
    Journal.open(str(path), SETTINGS, Outcome.of_dict).add(Case(1, "single"), OUTCOME)
    whole = path.read_text()
    path.write_text(whole + '{"seed": 2, "kin')
    assert list(Journal.open(str(path), SETTINGS, Outcome.of_dict).outcomes) == [Case(1, "single")]
    assert path.read_text() == whole


@pytest.mark.parametrize("text", ["my notes without newline", "my notes\n", "[]\n", "{}\n"])
def test_another_file_stays_as_it_is(tmp_path: Path, text: str) -> None:
    path = tmp_path / "notes"
    path.write_text(text)
    with pytest.raises(InputError, match="is no file of cases"):
        Journal.open(str(path), SETTINGS, Outcome.of_dict)
    assert path.read_text() == text


@pytest.mark.parametrize(
    "line", ["{}", "[1]", "null", "{", json.dumps({**OUTCOME.to_dict(), "asked": None, "seed": "x"})]
)
def test_a_damaged_line_is_named(tmp_path: Path, line: str) -> None:
    path = tmp_path / "cases"
    path.write_text(f"{json.dumps(SETTINGS)}\n{line}\n")
    with pytest.raises(InputError, match="line 2 is no case"):
        Journal.open(str(path), SETTINGS, Outcome.of_dict)


def test_cases_of_another_trial_are_refused(tmp_path: Path) -> None:
    path = str(tmp_path / "cases")
    Journal.open(path, SETTINGS, Outcome.of_dict)
    with pytest.raises(InputError, match=r"holds cases of noise 1.0, not 0.5"):
        Journal.open(path, {**SETTINGS, "noise": 0.5}, Outcome.of_dict)


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="no /dev/full here")
def test_a_full_disk_is_one_line(tmp_path: Path) -> None:
    journal = Journal(Path("/dev/full"))
    with pytest.raises(InputError, match=r"/dev/full: can't be written \(No space left on device\)"):
        journal.add(Case(1), OUTCOME)

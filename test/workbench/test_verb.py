"""The verb `workbench`: what it refuses before it serves anything."""

from __future__ import annotations

from pathlib import Path

import pytest

from robot_ident.cli.main import main


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["model.npz"], "model.npz: not a model; recordings go after --bag"),
        (["--validation", "run_3"], "needs recordings to fit"),
        (["--bag", "no_such_run"], "no_such_run: there is no such file or folder"),
        (["--bag", "run_1", "--validation", "run_1"], "for training and for validation"),
        (["--bag", "run_1", "--folder", "motion_0.yaml"], "--folder motion_0.yaml: is not a folder"),
    ],
)
def test_bad_input_ends_in_one_line(
    recordings: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    words: list[str],
    said: str,
) -> None:
    monkeypatch.chdir(recordings)
    capsys.readouterr()
    assert main(["workbench", *words, "--no-browser"]) == 2
    out, err = capsys.readouterr()
    assert said in err
    assert len(err.splitlines()) == 1
    assert out == ""
    assert not (recordings / "robot_ident_workbench").exists()

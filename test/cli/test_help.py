"""What the tool says of itself: `robot_ident` alone, its help, and a command that it doesn't know."""

from __future__ import annotations

import re
import subprocess
import sys
import time
from collections.abc import Callable
from typing import Any

import pytest

from robot_ident.cli.main import DESCRIPTION, GROUPS, VERBS, build_parser, main

Run = Callable[..., Any]
_HEADINGS = {
    "design": ("what to optimise", "motion", "limits", "search", "output"),
    "identify": ("model", "estimation", "reading the recordings", "signal processing", "output"),
    "diagnose": ("recordings", "model extension", "output"),
    "trial": ("what to hide", "recordings", "execution", "output"),
    "simulate": ("simulated robot", "recording", "output"),
}


def helped(capsys: pytest.CaptureFixture[str], *words: str) -> str:
    """Return the help that a command line prints on standard output."""
    with pytest.raises(SystemExit) as ended:
        main(words)
    said = capsys.readouterr()
    assert ended.value.code == 0 and not said.err
    return said.out


def test_robot_ident_alone_prints_the_help(capsys: pytest.CaptureFixture[str]) -> None:
    bare = helped(capsys)
    assert bare == helped(capsys, "--help") == helped(capsys, "help")
    assert " ".join(bare.split("\n\n")[1].split()) == DESCRIPTION


def test_commands_stand_under_their_headings(capsys: pytest.CaptureFixture[str]) -> None:
    text = helped(capsys)
    places = [text.index(f"\n{title}:\n") for title in GROUPS]
    assert places == sorted(places)
    assert re.findall(r"^  ([a-z]+) ", text, re.MULTILINE) == list(VERBS)
    assert len(VERBS) == sum(map(len, GROUPS.values())) == 22


@pytest.mark.parametrize("command", _HEADINGS)
def test_many_options_stand_under_headings(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    text = helped(capsys, command, "--help")
    assert text == helped(capsys, "help", command)
    places = [text.index(f"\n{title}:\n") for title in _HEADINGS[command]]
    assert places == sorted(places)
    assert f"\n{VERBS[command][0].upper()}{VERBS[command][1:30]}" in text


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (["identfy", "x"], "robot_ident: unknown command 'identfy'; did you mean 'identify'?"),
        (["desing", "--json"], "robot_ident: unknown command 'desing'; did you mean 'design'?"),
        (["zzz"], "robot_ident: unknown command 'zzz'; known: add, check, "),
        (["help", "zzz"], "robot_ident: unknown command 'zzz'; known: add, check, "),
        (["a\nb"], "robot_ident: unknown command 'a b'; known: "),
        ([""], "robot_ident: unknown command ''; known: "),
        (["--bogus"], "robot_ident: the following arguments are required: COMMAND"),
    ],
)
def test_an_unknown_command_is_one_line(run: Run, words: list[str], line: str) -> None:
    done = run(*words)
    assert done.code == 2 and not done.out
    assert done.err.startswith(line) and done.err.count("\n") == 1


def test_the_version(capsys: pytest.CaptureFixture[str]) -> None:
    assert re.fullmatch(r"robot_ident \d+\.\d+\.\d+\n", helped(capsys, "--version"))


def test_the_help_is_there_at_once() -> None:
    taken = []
    for _ in range(3):
        started = time.perf_counter()
        done = subprocess.run([sys.executable, "-m", "robot_ident"], capture_output=True, timeout=60, check=False)
        taken.append(time.perf_counter() - started)
        assert done.returncode == 0 and done.stdout and not done.stderr
    assert min(taken) < 1.0  # 0.1 s on an idle machine


def test_options_of_several_values_have_what_their_command_takes_without_them() -> None:
    parser = build_parser()
    assert parser.parse_args(["paper"]).section == [1, 2, 3, 4, 5, 6]
    assert parser.parse_args(["demo"]).hidden is None, "the demo's own effects"
    assert parser.parse_args(["demo", "--hidden"]).hidden == [], "none at all"
    assert parser.parse_args(["design"]).effect == []

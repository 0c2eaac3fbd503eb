"""What verbs print: tables that a terminal can hold, plain lines where they are piped."""

from __future__ import annotations

import io
import os
import subprocess
import sys
from collections.abc import Callable

import pytest

from robot_ident.cli.main import main
from robot_ident.cli.output import say, table

ROWS = [("stribeck", 1.5, "friction that falls as a lubricant film builds up between the surfaces of the gear")]
HEADER = ("effect", "size", "meaning")


class Terminal(io.StringIO):
    """A standard output that somebody looks at."""

    def isatty(self) -> bool:
        return True


@pytest.fixture
def terminal(monkeypatch: pytest.MonkeyPatch) -> Callable[..., Terminal]:
    def begin(**environment: str) -> Terminal:
        monkeypatch.setattr("shutil.get_terminal_size", lambda *_: os.terminal_size((60, 24)))
        monkeypatch.delenv("NO_COLOR", raising=False)
        for name, value in ({"TERM": "xterm"} | environment).items():
            monkeypatch.setenv(name, value)
        monkeypatch.setattr(sys, "stdout", Terminal())
        return sys.stdout

    return begin


def test_what_is_piped_stays_on_one_line_and_plain(capsys: pytest.CaptureFixture[str]) -> None:
    say(table(HEADER, ROWS))
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 3
    assert "\x1b" not in "".join(lines)
    assert lines[2].split()[:2] == ["stribeck", "1.5"]


def test_a_terminal_gets_lines_that_fit(terminal: Callable[..., Terminal]) -> None:
    shown = terminal()
    text = table(HEADER, ROWS)
    lines = text.splitlines()
    assert max(len(line) for line in lines) <= 60
    words = " ".join(lines[2:]).split()
    assert [word for word in words if word not in ("stribeck", "1.5")] == ROWS[0][2].split()
    say(text)
    assert shown.getvalue().startswith(f"\x1b[1m{lines[0]}\x1b[0m")


@pytest.mark.parametrize("environment", [{"NO_COLOR": "1"}, {"TERM": "dumb"}])
def test_colour_is_left_out_on_request(terminal: Callable[..., Terminal], environment: dict[str, str]) -> None:
    shown = terminal(**environment)
    say(table(HEADER, ROWS) + "\n█████·····")
    assert "\x1b" not in shown.getvalue()


def test_numbers_are_never_broken(terminal: Callable[..., Terminal]) -> None:
    terminal()
    rows = [tuple(1.23456789e-10 for _ in range(9))]
    assert table("abcdefghi", rows).splitlines()[2].split() == ["1.235e-10"] * 9


def test_rows_may_come_one_by_one() -> None:
    lines = table(("name", "value"), ((f"row {k}", k) for k in range(2))).splitlines()
    assert lines[2:] == ["row 0      0", "row 1      1"]


INTERRUPTED = """
import importlib, os, signal, sys
from robot_ident.cli.main import main

def interrupted(name):
    try:
        os.kill(os.getpid(), signal.SIGINT)
    except KeyboardInterrupt:
        raise ImportError("a bad install") from None

signal.signal(signal.SIGINT, signal.default_int_handler)  # whatever those who started us do with it
importlib.import_module = interrupted
code = main(["identify", "bag"])
assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
sys.exit(code)
"""


def test_ctrl_c_is_one_line_whatever_an_import_makes_of_it() -> None:
    done = subprocess.run([sys.executable, "-P", "-c", INTERRUPTED], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (130, "robot_ident identify: stopped; nothing was written\n")


def test_ctrl_c_while_a_verb_is_loaded_is_one_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(name: str) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("robot_ident.cli.main.importlib.import_module", interrupted)
    assert main(["identify", "bag"]) == 130
    assert capsys.readouterr().err == "robot_ident identify: stopped; nothing was written\n"

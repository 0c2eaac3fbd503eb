"""What commands print: one JSON object, or aligned tables, what no certificate covers first; progress goes to standard
error.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import shutil
import sys
import textwrap
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, NoReturn, TextIO

from robot_ident.errors import CheckFailed, InputError
from robot_ident.files import is_special, refuse_existing

if TYPE_CHECKING:
    from robot_ident.limits.certifier import Margins


_RULE = re.compile(r"-+(  -+)*")  # the line below a table's header
_LENGTHEN = ("add", "diagnose")  # verbs whose output is their model with something more
_OUTPUTS = ("output", "page", "mcap")  # options that name a file to write
_WRITE_FOLDERS = ("simulate", "recover", "predict", "demo", "trial")  # verbs whose output may be a folder
_RECORDINGS = (".mcap", ".db3", ".npz", ".csv")
_NARROW = 16  # characters that a column of words keeps where a terminal is too narrow for the table


class Parser(argparse.ArgumentParser):
    """A parser that says what is wrong in one line."""

    def error(self, message: str) -> NoReturn:
        """Print the line and exit with 2."""
        tell(f"{self.prog}: {message}")
        sys.exit(2)

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Parse as ever, and refuse words that no option can mean: an empty one, and the name of a device or a pipe."""
        found, rest = super().parse_known_args(args, namespace)
        for action in self._actions:
            for word in _words(getattr(found, action.dest, None)):
                name = "/".join(action.option_strings) or str(action.metavar or action.dest)
                if not word.strip():
                    self.error(f"argument {name}: the word given is empty; give a name or a value, or leave it out")
                if is_special(word):
                    self.error(f"argument {name}: {word} is a device, a pipe or a socket; give a file or a folder")
        return found, rest


def _words(value: Any) -> Iterator[str]:
    """Yield the words of an option's value."""
    for word in value if isinstance(value, list) else [value]:
        if isinstance(word, str):
            yield word


def refuse_outputs(args: argparse.Namespace) -> None:
    """Raise InputError where two outputs have one name, an output that of what is read, or is there already: --force
    replaces what was computed, and no measurement, robot or trajectory. A longer model may take the place of the one
    that it came from.
    """
    given = {name: value for name, value in vars(args).items() if value}
    outputs = {name: os.path.realpath(given[name]) for name in _OUTPUTS if isinstance(given.get(name), str)}
    if len(set(outputs.values())) < len(outputs):
        raise InputError(f"{' and '.join(given[name] for name in outputs)}: two outputs need two names")
    output = given.get("output")
    if isinstance(output, str) and os.path.isdir(output) and args.verb not in _WRITE_FOLDERS:
        raise InputError(f"-o {output}: is a folder; the name of a file was expected")
    for name, value in given.items():
        for word in _words(value):
            if name in outputs or os.path.realpath(word) not in outputs.values():
                continue
            if os.path.isdir(word) or word.endswith(_RECORDINGS):
                raise InputError(f"{word}: is read as a recording and can't be the output too; give another name")
            if os.path.isfile(word) and os.path.splitext(word)[1] and args.verb not in _LENGTHEN:
                raise InputError(f"{word}: is read by this command and can't be its output too; give another name")
    for name in outputs:
        if name != "output" or getattr(args, "trajectories", 1) == 1:  # else the files have names of their own
            refuse_existing(given[name], force=args.force)


def say(*texts: str) -> None:
    """Print a result; in a terminal with the headers of its tables in bold, unless NO_COLOR is set."""
    text = "\n".join(texts)
    _out(_dressed(text) if _coloured() else text)


def _coloured() -> bool:
    return sys.stdout.isatty() and not os.environ.get("NO_COLOR") and os.environ.get("TERM") != "dumb"


def _dressed(text: str) -> str:
    lines = text.split("\n")
    for k, line in enumerate(lines):
        if k and _RULE.fullmatch(line):
            lines[k - 1], lines[k] = f"\x1b[1m{lines[k - 1]}\x1b[0m", f"\x1b[2m{line}\x1b[0m"
    return re.sub("(█+)", "\x1b[36m\\1\x1b[0m", "\n".join(lines))


def tell(*lines: str) -> None:
    """Print log lines on standard error; where that takes no more, nobody is told, and the work goes on."""
    try:
        for line in lines:
            print(line, file=sys.stderr, flush=True)
    except OSError:
        _discard(sys.stderr)


def say_written(*files: str | os.PathLike[str] | None) -> None:
    """Print which files were written, None where one was not asked for."""
    for file in files:
        if file:
            say(f"written: {file}")


def print_json(data: dict[str, Any]) -> None:
    """Print one JSON object; a number that isn't finite is null."""
    _out(json.dumps(_finite(data), indent=2))
    flush()


def _out(text: str) -> None:
    with _writable():
        print(text)


def flush() -> None:
    """Write out what was printed; InputError where standard output takes no more."""
    with _writable():
        sys.stdout.flush()


@contextmanager
def _writable() -> Iterator[None]:
    try:
        yield
    except BrokenPipeError:  # the reader has had enough
        raise
    except OSError as error:
        _discard(sys.stdout)
        raise InputError(f"standard output can't be written ({error.strerror or error})") from error


def _discard(stream: TextIO) -> None:
    """Let what is left in a stream's buffer, and all that comes, go nowhere."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite(item) for item in value]
    if isinstance(value, float) and value - value != 0.0:
        return None
    return value


def table(header: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    """Return aligned columns: words to the left, numbers to the right.

    Where a terminal is too narrow, its widest columns of words are wrapped; what is piped stays on one line a row.
    """
    rows = list(rows)
    cells = [[_cell(value) for value in row] for row in rows]
    numeric = [all(isinstance(row[k], (int, float, type(None))) for row in rows) for k in range(len(header))]
    widths = [max([len(name), *(len(row[k]) for row in cells)]) for k, name in enumerate(header)]
    if sys.stdout.isatty():
        widths = _narrowed(widths, numeric, shutil.get_terminal_size().columns)

    def line(row: Sequence[str]) -> str:
        return "  ".join(
            c.rjust(w) if right else c.ljust(w) for c, w, right in zip(row, widths, numeric, strict=True)
        ).rstrip()

    lines = [line(row) for whole in (header, *cells) for row in _wrapped(whole, widths)]
    head = len(_wrapped(header, widths))
    return "\n".join([*lines[:head], "  ".join("-" * w for w in widths), *lines[head:]])


def _narrowed(widths: Sequence[int], numeric: Sequence[bool], columns: int) -> list[int]:
    """Return widths that fit a terminal, as far as its columns of words can give way."""
    out = list(widths)
    beyond = sum(out) + 2 * (len(out) - 1) - columns
    while beyond > 0:
        widest = max((k for k, right in enumerate(numeric) if not right), key=lambda k: out[k], default=None)
        if widest is None or out[widest] <= _NARROW:
            return out
        out[widest] -= 1
        beyond -= 1
    return out


class _Wrapper(textwrap.TextWrapper):
    """Breaks `effect@joint` before the joint."""

    wordsep_simple_re = re.compile(r"(\s+|(?=@))")


def _wrapped(row: Sequence[str], widths: Sequence[int]) -> list[list[str]]:
    """Return a row as the lines that its cells need."""
    parts = [
        [cell] if len(cell) <= width else _Wrapper(width, break_on_hyphens=False).wrap(cell)
        for cell, width in zip(row, widths, strict=True)
    ]
    return [[part[k] if k < len(part) else "" for part in parts] for k in range(max(map(len, parts)))]


def _cell(value: Any) -> str:
    if value is None:
        return "-"
    if isinstance(value, float):
        return f"{value:.4g}"
    return str(value)


class Progress:
    """A progress bar on standard error where that is a terminal, shown for what takes over two seconds."""

    def __init__(self, label: str, total: float) -> None:
        """Name the bar; `total` is what `reach` counts up to."""
        from tqdm import tqdm

        form = "{l_bar}{bar}| {elapsed}<{remaining}{postfix}"
        self._bar = tqdm(
            total=total, desc=label, leave=False, delay=2.0, bar_format=form, disable=not sys.stderr.isatty()
        )

    def __enter__(self) -> Progress:
        """Return the bar."""
        return self

    def __exit__(self, *error: object) -> None:
        """Remove the bar."""
        self._bar.close()

    def reach(self, done: float, note: str = "") -> None:
        """Move the bar to `done` of its total."""
        self._bar.set_postfix_str(note, refresh=False)
        self._bar.update(done - self._bar.n)


_HEAD = ("limit", "joint, rule or links", "reached", "allowed", "margin", "unit", "at t [s]", "by")


def margin_table(margins: Margins) -> str:
    """Return the tightest point of every limit, and below what was left out on purpose."""
    rows = [item.cells for item in margins.items]
    return "\n".join([table(_HEAD, rows), *margins.notes])


def say_unchecked(margins: Margins) -> None:
    """Print what was not checked, if anything: the first line of a verb's output."""
    if margins.not_checked:
        say(margins.not_checked)


def refuse_unchecked(args: argparse.Namespace, margins: Margins, written: Sequence[str] = ()) -> None:
    """Raise CheckFailed where something was not checked and nobody has accepted that.

    written: files of motions that are there all the same, which another command can accept.
    """
    from robot_ident.limits.certifier import unchecked_refusal

    kept = " and ".join(f"robot_ident check {file} --robot {args.robot} --accept-unchecked" for file in written)
    refusal = unchecked_refusal(margins.unknown, f"accept it: {kept}" if kept else "give --accept-unchecked")
    if refusal and not args.accept_unchecked:
        raise CheckFailed(refusal)

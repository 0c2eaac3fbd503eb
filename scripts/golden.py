"""Golden outputs: what every command answers to a few small, fixed recordings of two robots.

`golden.py` runs the commands of test/golden/commands.txt in their order in a new folder that holds test/golden/inputs,
and compares what they answer with test/golden/outputs: exit codes, files written, first lines of messages, and the JSON
as a line a value, numbers to six digits. A difference is printed as a diff and ends it with exit code 1. `golden.py
--write` renews the outputs instead; `golden.py VERB...` runs the commands up to the last of these verbs and looks at
these alone.
"""

from __future__ import annotations

import argparse
import difflib
import io
import json
import math
import os
import re
import shlex
import shutil
import sys
import tempfile
from collections.abc import Iterator
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from typing import Any

GOLDEN = Path(__file__).resolve().parents[1] / "test" / "golden"
CLOSE = 1e-5  # relative difference of two numbers that are the same: processors and releases of BLAS round differently
NOTHING = 1e-13  # below it a number is what rounding leaves of zero
FEW = 12  # numbers that stand in a line as they are; of more their count, mean, root mean square and extremes
UNLIKE = ("date", "sha256", "seconds", "diagnosis_seconds", "bytes", "numpy", "robot_ident")  # differ from run to run
NUMBER = re.compile(r"(?<![\w.])[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?(?![\w])")


def number(value: float) -> str:
    """Return a number to six digits, the same for what rounding leaves of zero."""
    return "0" if abs(value) < NOTHING else f"{value:.6g}"


def flat(value: Any, name: str = "") -> Iterator[str]:
    """Yield a line for every value of a JSON object, a line for every plain record of a list."""
    if isinstance(value, dict) and value:
        for key, inner in value.items():
            if key not in UNLIKE:
                yield from flat(inner, f"{name}.{key}" if name else key)
    elif isinstance(value, list) and value and all(map(_is_record, value)):
        columns = {key: [row.get(key) for row in value] for row in value for key in row}
        if len(value) > FEW // 3 and all(_numbers(column) for column in columns.values()):
            yield from flat(columns, f"{name}[]")
        else:
            for k, row in enumerate(value):
                cells = (f"{key} {_cell(x)}" for key, x in row.items() if key != "name" and key not in UNLIKE)
                yield f"{name}[{row.get('name', k)}]: {', '.join(cells)}"
    elif isinstance(value, list) and value and _numbers(value) is None:
        for k, inner in enumerate(value):
            label = inner.get("name", k) if isinstance(inner, dict) else k
            yield from flat(inner, f"{name}[{label}]")
    else:
        yield f"{name} = {_cell(value)}"


def _is_record(value: Any) -> bool:
    return isinstance(value, dict) and not any(isinstance(x, dict) or x and isinstance(x, list) for x in value.values())


def _cell(value: Any) -> str:
    """Return how a value stands in a line: of many numbers how many, between which, their mean and root mean square."""
    found = _numbers(value)
    if not found:
        return json.dumps(value, ensure_ascii=False)
    if not isinstance(value, list):
        return number(found[0])
    if len(found) <= FEW:
        return f"[{', '.join(map(number, found))}]"
    mean, rms = sum(found) / len(found), math.sqrt(sum(x * x for x in found) / len(found))
    extremes = f"from {number(min(found))} to {number(max(found))}"
    return f"{len(found)} numbers {extremes}, mean {number(mean)}, rms {number(rms)}"


def _numbers(value: Any) -> list[float] | None:
    """Return the numbers of a list, or of a list of lists, of nothing but numbers; else None."""
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        return [float(value)]
    if not isinstance(value, list):
        return None
    parts = [_numbers(inner) for inner in value]
    return None if any(part is None for part in parts) else [x for part in parts if part for x in part]


def answer(words: list[str]) -> list[str]:
    """Run a command; return the lines that are kept of its answer."""
    from robot_ident.cli.main import main

    before = written()
    out, err = io.StringIO(), io.StringIO()
    with redirect_stdout(out), redirect_stderr(err):
        try:
            code = main(words)
        except SystemExit as ended:
            code = int(ended.code or 0)
    lines = [f"exit code {code}"]
    if new := sorted(written() - before):
        lines.append("written: " + ", ".join(new))
    said = [line for line in err.getvalue().splitlines() if line.strip()]
    lines += [f"standard error: {line}" for line in said[:1]]
    if "--json" in words and out.getvalue():
        lines += flat(json.loads(out.getvalue()))
    elif printed := next((line for line in out.getvalue().splitlines() if line.strip()), ""):
        lines.append(f"standard output: {printed}")
    return lines


def written() -> set[str]:
    """Return the files below this folder."""
    return {str(file) for file in Path(".").rglob("*") if file.is_file()}


def usage() -> list[str]:
    """Return the options of every verb: names, value, default, help. argparse lays them out anew with every Python."""
    from robot_ident.cli.main import DESCRIPTION, GROUPS, VERBS, build_parser

    lines = ["", DESCRIPTION]
    for title, commands in GROUPS.items():
        lines += ["", f"{title}:", *(f"  {name}: {text}" for name, text in commands.items())]
    for verb in VERBS:
        top = build_parser(verb)
        verbs = next(a for a in top._actions if isinstance(a, argparse._SubParsersAction))
        lines += ["", f"{verb}: {verbs.choices[verb].description}"]
        for action in verbs.choices[verb]._actions:
            name = ", ".join(action.option_strings) or str(action.metavar or action.dest)
            value = (
                "" if not action.option_strings or action.nargs == 0 else f" {action.metavar or action.dest.upper()}"
            )
            lines.append(f"  {name}{value}: {action.help}")
    return lines


def same(old: str, new: str) -> bool:
    """Return whether two lines are the same but for the rounding of their numbers."""
    if NUMBER.sub("#", old) != NUMBER.sub("#", new):
        return False
    pairs = zip(map(float, NUMBER.findall(old)), map(float, NUMBER.findall(new)), strict=True)
    return all(abs(a - b) <= CLOSE * max(abs(a), abs(b)) + NOTHING for a, b in pairs)


def difference(name: str, old: list[str], new: list[str]) -> str:
    """Return a unified diff, in which numbers that are the same are no difference; empty where all is the same."""
    kept = list(new)
    plain = [[NUMBER.sub("#", line) for line in lines] for lines in (old, new)]
    for _, i, j, k, m in difflib.SequenceMatcher(None, *plain, autojunk=False).get_opcodes():
        if j - i == m - k:
            kept[k:m] = [a if same(a, b) else b for a, b in zip(old[i:j], new[k:m], strict=True)]
    return "\n".join(difflib.unified_diff(old, kept, f"golden/{name}", f"now/{name}", n=2, lineterm=""))


def run(verbs: list[str]) -> dict[str, list[str]]:
    """Run the commands; return the lines by file name."""
    commands = [line for line in (GOLDEN / "commands.txt").read_text().splitlines() if line and line[0] != "#"]
    if verbs:
        last = max((k for k, line in enumerate(commands) if shlex.split(line)[0] in verbs), default=-1)
        commands = commands[: last + 1]
    found: dict[str, list[str]] = {} if verbs else {"help.txt": usage()}
    for line in commands:
        words = shlex.split(line)
        lines = answer(words)
        if not verbs or words[0] in verbs:
            found.setdefault(f"{words[0]}.txt", []).extend(["", f"$ robot_ident {' '.join(words)}", *lines])
    return found


def main() -> int:
    """Run, and compare or write."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("verbs", nargs="*", metavar="VERB")
    parser.add_argument("--write", action="store_true", help="renew the golden outputs")
    args = parser.parse_args()
    os.environ["COLUMNS"] = "120"
    outputs, here = GOLDEN / "outputs", Path.cwd()
    with tempfile.TemporaryDirectory() as folder:
        shutil.copytree(GOLDEN / "inputs", folder, dirs_exist_ok=True)
        os.chdir(folder)
        try:
            found = run(args.verbs)
        finally:
            os.chdir(here)
    if args.write:
        for name, lines in found.items():
            (outputs / name).write_text("\n".join(lines[1:]) + "\n", encoding="utf-8")
        return 0
    known = {file.name for file in outputs.glob("*.txt")}
    missing = set() if args.verbs else known - set(found)
    texts = {name: (outputs / name).read_text(encoding="utf-8").splitlines() if name in known else [] for name in found}
    diffs = [diff for name, lines in found.items() if (diff := difference(name, texts[name], lines[1:]))]
    diffs += [f"golden/{name}: no command answers it any more" for name in sorted(missing)]
    print("\n".join(diffs) or "all answers are the golden ones")
    return 1 if diffs else 0


if __name__ == "__main__":
    sys.exit(main())

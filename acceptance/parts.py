"""The parts of `make acceptance`: says how long each takes before any begins, and which files they are.

`parts.py [--files] [PART...]`: a part is the `recorder` of `test_recorder.py`; without one, all.
"""

from __future__ import annotations

import ast
import sys
from pathlib import Path

MINUTES = {
    "long": 30,
    "estimation": 10,
    "intervals": 6,
    "diagnosis": 360,
    "foreign": 30,
    "mujoco": 60,
    "one_axis": 8,
    "real": 3,
    "like_real": 25,
    "causes": 60,
    "planted": 20,
    "measurement": 20,
    "robots": 20,
    "recorder": 4,
    "attack": 15,
    "scale": 20,
    "faults": 10,
    "ends": 10,
    "soak": 60,
    "fuzz": 30,
    "demo": 90,
    "paper": 2,
}
"""On two cores that nothing else uses."""

FOLDER = Path(__file__).resolve().parent


def chosen(words: list[str]) -> list[str]:
    """Return the parts that were named, all where none was; SystemExit names one that isn't there."""
    known = [file.stem.removeprefix("test_") for file in FOLDER.glob("test_*.py")]
    known.sort(key=lambda part: (list(MINUTES).index(part) if part in MINUTES else len(MINUTES), part))
    for word in words:
        if word not in known:
            raise SystemExit(f"acceptance has no part {word!r}; it has {' '.join(known)}")
    return [part for part in known if part in words or not words]


def file_of(part: str) -> Path:
    return FOLDER / f"test_{part}.py"


def table(parts: list[str]) -> str:
    """Return a line for each part, and the time of all."""
    lines = []
    for part in parts:
        told = ast.get_docstring(ast.parse(file_of(part).read_text(encoding="utf-8"))) or ""
        minutes = f"{MINUTES[part]:4d} min" if part in MINUTES else "   ? min"
        lines.append(f"  {part:<12} {minutes}  {told.splitlines()[0] if told else ''}")
    hours = sum(MINUTES.get(part, 0) for part in parts) / 60
    return "\n".join([*lines, f"About {hours:.1f} hours on 2 cores; the tables are printed as they come."])


def main(words: list[str]) -> None:
    parts = chosen([word for word in words if word != "--files"])
    print(" ".join(str(file_of(part)) for part in parts) if "--files" in words else table(parts))


if __name__ == "__main__":
    main(sys.argv[1:])

"""Counts the house: a table of the rooms of robot_ident, with lines, files, imports and constants, for the change log.

`house.py [FOLDER]` counts a package (default: robot_ident beside this script).
"""

from __future__ import annotations

import ast
import hashlib
import re
import sys
from collections import Counter, defaultdict
from collections.abc import Iterator
from pathlib import Path

SMALL, LARGE = 30, 600  # lines below which a file asks to join another, above which to be two
WINDOW = 4  # statements in a row that count as written twice where others do the same to other names
COLUMNS = ("lines", "files", f"< {SMALL}", f"> {LARGE}", "imports", "constants", "twice")


def constants(tree: ast.Module) -> int:
    """Return how many names of a module are set to a plain number: what somebody has tuned or measured."""
    assigned = (node.value for node in tree.body if isinstance(node, (ast.Assign, ast.AnnAssign)))
    signless = (value.operand if isinstance(value, ast.UnaryOp) else value for value in assigned)
    return sum(isinstance(value, ast.Constant) and type(value.value) in (int, float) for value in signless)


def bodies(tree: ast.Module) -> Iterator[str]:
    """Yield every stretch of WINDOW statements that follow one another, by a digest of its shape."""
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        if isinstance(body, list) and not isinstance(node, (ast.Module, ast.ClassDef)):
            texts = [re.sub(r"'[^']*'", "", ast.dump(statement)) for statement in body]
            for k in range(len(texts) - WINDOW + 1):
                yield hashlib.sha256("".join(texts[k : k + WINDOW]).encode()).hexdigest()


def count(package: Path) -> dict[str, Counter[str]]:
    """Return the counts of each room."""
    rooms: dict[str, Counter[str]] = defaultdict(Counter)
    seen: set[str] = set()
    for file in sorted(package.rglob("*.py")):
        parts = file.relative_to(package).parts
        room, text = rooms[parts[0] if len(parts) > 1 else "."], file.read_text(encoding="utf-8")
        tree, lines = ast.parse(text), len(text.splitlines())
        stretches = list(bodies(tree))
        room.update(
            {
                "lines": lines,
                "files": 1,
                f"< {SMALL}": int(lines < SMALL and file.name != "__init__.py"),
                f"> {LARGE}": int(lines > LARGE),
                "imports": sum(isinstance(node, (ast.Import, ast.ImportFrom)) for node in ast.walk(tree)),
                "constants": constants(tree),
                "twice": sum(digest in seen for digest in stretches),
            }
        )
        seen.update(stretches)
    return rooms


def main() -> int:
    """Print the table."""
    package = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).resolve().parents[1] / "robot_ident"
    rooms = count(package)
    rows = [("room", *COLUMNS)]
    rows += [(name, *(str(rooms[name][column]) for column in COLUMNS)) for name in sorted(rooms)]
    rows.append(("all", *(str(sum(room[column] for room in rooms.values())) for column in COLUMNS)))
    widths = [max(map(len, cells)) for cells in zip(*rows, strict=True)]
    for name, *cells in rows:
        print(name.ljust(widths[0]), *(cell.rjust(width) for cell, width in zip(cells, widths[1:], strict=True)))
    return 0


if __name__ == "__main__":
    sys.exit(main())

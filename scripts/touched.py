"""Prints the tests of what differs from a commit (default: HEAD), for `make check`: a changed test file; for a changed
module the test file of its name, or all of its room where it has none; always that every import names something. Those
of the nodes take minutes: `make test`.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path, PurePosixPath


def changed(commit: str) -> set[str]:
    """Return the files that differ from a commit, or that git doesn't know yet."""
    asked = (["diff", "--name-only", commit], ["ls-files", "--others", "--exclude-standard"])
    return {line for words in asked for line in subprocess.check_output(["git", *words], text=True).splitlines()}


def tests(files: set[str]) -> set[str]:
    """Return the test files and folders of changed files."""
    found = {"test/test_house.py"} if files else set()
    for file in map(PurePosixPath, files):
        top, *rest = file.parts
        if top == "test" and file.name.startswith("test_") and file.suffix == ".py":
            found.add(str(file))
        elif top == "robot_ident" and len(rest) > 1:
            mirrored = PurePosixPath("test", *rest[:-1], f"test_{file.name}")
            found.add(str(mirrored) if Path(mirrored).exists() else f"test/{rest[0]}")
        elif top == "robot_ident":
            found.add(f"test/test_{file.name}")
        elif top in ("setup.py", "package.xml", "MANIFEST.in", "requirements"):
            found |= {"test/test_packaging.py", "test/test_locks.py"}
    return {test for test in found if Path(test).exists() and not test.startswith("test/nodes")}


if __name__ == "__main__":
    for test in sorted(tests(changed(sys.argv[1] if len(sys.argv) > 1 else "HEAD"))):
        print(test)

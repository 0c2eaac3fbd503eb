"""Every command answers as it did; `scripts/golden.py --write` takes in a wanted change, the change log tells it."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path


def test_every_command_answers_as_it_did(checkout: Path) -> None:
    program = [sys.executable, str(checkout / "scripts" / "golden.py")]
    done = subprocess.run(program, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stdout + done.stderr

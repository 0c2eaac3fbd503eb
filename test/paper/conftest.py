"""The paper's page, made once by the command."""

from __future__ import annotations

import contextlib
import io
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from robot_ident.cli.main import main


@dataclass(frozen=True)
class Made:
    """The page of `paper --quick` and its figures."""

    page: Path
    data: Any


@pytest.fixture(scope="session")
def made(tmp_path_factory: pytest.TempPathFactory) -> Made:
    path = tmp_path_factory.mktemp("paper") / "paper.html"
    out = io.StringIO()
    with contextlib.redirect_stdout(out):
        assert main(["paper", "--quick", "--seed", "3", "-o", str(path), "--json"]) == 0
    return Made(path, json.loads(out.getvalue()))

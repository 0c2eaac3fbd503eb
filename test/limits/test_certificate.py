"""The benchmark of the certificate, in small."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

import pytest


def test_a_denser_grid_finds_nothing(
    checkout: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path = checkout / "benchmarks" / "certificate.py"
    spec = importlib.util.spec_from_file_location("certificate", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, "certificate", module)
    spec.loader.exec_module(module)
    monkeypatch.setattr(sys, "argv", [str(path), "--trajectories", "10", "--seed", "7"])
    module.main()
    rows = [line.split() for line in capsys.readouterr().out.splitlines()[3:]]
    assert {row[0] for row in rows} == {"position", "velocity", "acceleration", "workspace", "torque"}
    assert all(row[2:4] == ["0", "0"] for row in rows)

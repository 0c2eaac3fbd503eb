"""Finite numbers beyond what a robot can have: no warning of NumPy, no traceback, one line at most."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from robot_ident.cli.main import main

INPUTS = Path(__file__).parents[1] / "golden" / "inputs"
CHANGES: dict[str, Callable[[dict[str, Any]], Any]] = {
    "tiny efforts": lambda r: r.update(tau=r["tau"] * 1e-300),
    "a huge effort": lambda r: r["tau"].__setitem__((100, 1), 1e200),
    "a huge position": lambda r: r["q"].__setitem__((100, 1), 1e200),
    "constant efforts": lambda r: r.update(tau=0 * r["tau"] + 3.0),
    "one joint stands still": lambda r: r["q"].__setitem__((slice(None), 1), 0.3),
    "one sample": lambda r: r.update({key: r[key][:1] for key in ("t", "q", "tau")}),
    "times to a tenth of a second": lambda r: r.update(
        {key: r[key][:3000] for key in ("q", "tau")}, t=r["t"][:3000].round(1)
    ),
    "no time": lambda r: r.update(t=1e-200 * r["t"]),
}


def told(words: list[str], capsys: pytest.CaptureFixture[str]) -> tuple[int, str]:
    """Return the exit code of a verb that warns of nothing, and what it says on standard error."""
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        code = main(words)
    return code, capsys.readouterr().err


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> str:
    """A model of the arm."""
    path = str(tmp_path_factory.mktemp("model") / "model.yaml")
    assert main(["identify", str(INPUTS / "kuka_1.npz"), "-o", path]) == 0
    return path


@pytest.mark.parametrize("change", CHANGES.values(), ids=list(CHANGES))
def test_odd_recordings(
    change: Callable[[dict[str, Any]], Any], model: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with np.load(INPUTS / "kuka_1.npz") as archive:
        recording = {key: value.astype(float) if key != "names" else value for key, value in archive.items()}
    change(recording)
    path = str(tmp_path / "odd.npz")
    np.savez(path, **recording)
    for words in (["identify", path], ["compare", model, path]):
        code, _ = told(words, capsys)
        assert code in (0, 2)


@pytest.mark.parametrize(("frequency", "rate"), [(1e28, 1e30), (1e-30, 1e-28), (1e-300, 1e-298)])
def test_frequencies_that_no_robot_has(
    frequency: float, rate: float, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = (INPUTS / "excitation_1.yaml").read_text()
    path = tmp_path / "odd.yaml"
    text = text.replace("base_frequency: 0.2", f"base_frequency: {frequency!r}", 1)
    path.write_text(text.replace("sample_rate: 100.0", f"sample_rate: {rate!r}", 1).replace("e+", ".0e+"))
    for words in (["check", str(path)], ["simulate", str(path), "-o", str(tmp_path / "out.npz")]):
        code, error = told(words, capsys)
        assert code == 2 and error.count("\n") == 1, error
        assert "frequency" in error

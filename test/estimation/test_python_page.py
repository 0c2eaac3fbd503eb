"""The page on Python runs as it stands, and shows each of the five names."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

FIVE = ("Robot", "Excitation", "Recording", "identify", "Model")


def test_every_example_of_the_page_runs(
    checkout: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    text = (checkout / "docs/python.md").read_text(encoding="utf-8")
    sections = dict(re.findall(r"^## (\w+)\n(.*?)(?=^## |\Z)", text, re.MULTILINE | re.DOTALL))
    assert tuple(sections) == FIVE
    for name, section in sections.items():
        blocks = re.findall(r"```python\n(.*?)```", section, re.DOTALL)
        assert len(blocks) == 1, f"{name} has {len(blocks)} examples"
        assert re.search(rf"\b{name}\b", blocks[0])
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {}
    for block in re.findall(r"```python\n(.*?)```", text, re.DOTALL):
        exec(compile(block, "docs/python.md", "exec"), names)  # noqa: S102
    printed = capsys.readouterr().out
    assert "('joint_1', 'joint_2', 'joint_3') [1.45 1.45 1.45]" in printed
    assert "torque_offset@joint_1" in printed
    model = names["model"]
    np.testing.assert_array_equal(names["again"].values, model.values)
    assert names["torque"].shape == (1500, 3)
    truth = model.structure.true_values()
    error = model.values - truth
    assert error @ np.linalg.solve(model.covariance, error) / len(truth) < 3.0
    html = model._repr_html_()
    assert "torque_offset@joint_1" in html
    assert "<script" not in html

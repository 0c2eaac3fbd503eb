"""The notebook of the examples runs as it stands, and what is stored in it is what it gives."""

from __future__ import annotations

import ast
import json
from pathlib import Path
from typing import Any

import pytest

NOTEBOOK = "examples/find_what_is_missing.ipynb"


def run_cell(source: str, names: dict[str, Any]) -> Any:
    """Run a cell as a notebook does; return the value of its last line where that is an expression."""
    tree = ast.parse(source)
    last = tree.body.pop() if isinstance(tree.body[-1], ast.Expr) else None
    exec(compile(tree, NOTEBOOK, "exec"), names)
    return None if last is None else eval(compile(ast.Expression(last.value), NOTEBOOK, "eval"), names)


@pytest.mark.long
def test_it_runs_and_shows_what_is_stored(
    checkout: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    cells = json.loads((checkout / NOTEBOOK).read_text(encoding="utf-8"))["cells"]
    names: dict[str, Any] = {}
    shown = 0
    for cell in cells:
        if cell["cell_type"] != "code":
            continue
        value = run_cell("".join(cell["source"]), names)
        stored = cell["outputs"][0]["data"] if cell["outputs"] else {}
        assert (value is not None) == bool(stored), "run the notebook anew: its outputs are of other cells"
        if "text/html" in stored:
            assert value._repr_html_().startswith(("<p>", "<table>"))
            shown += 1
        elif stored:
            assert repr(value) == "".join(stored["text/plain"])
    assert shown == 4
    assert names["found"].in_words == "missing: load_friction@joint_2"
    assert any(
        names["found"].in_words in "".join(out["data"].get("text/html", ""))
        for c in cells
        for out in c.get("outputs", [])
    )
    assert capsys.readouterr().out == ""
    assert not list(tmp_path.iterdir())

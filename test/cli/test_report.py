"""`robot_ident report`: the page and its figures; bad input in one line."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from robot_ident.model.model_file import write_model

if TYPE_CHECKING:
    from robot_ident.workflow.findings import Findings

Run = Callable[..., Any]


@pytest.fixture(scope="module")
def models(findings: Findings, tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    folder = tmp_path_factory.mktemp("models")
    paths = [folder / f"{step.name}.yaml" for step in findings.steps]
    for path, step in zip(paths, findings.steps, strict=True):
        write_model(step.model, path)
    return paths


def test_it_writes_a_page_and_says_the_verdict(
    run: Run, findings: Findings, models: list[Path], tmp_path: Path
) -> None:
    bags, page = [source.path for source in findings.training], tmp_path / "report.html"
    words = ["report", *models, "--bag", *bags, "--validation", findings.validation[0].path, "-o", page]
    done = run(*words)
    assert done.code == 0, done.err
    assert done.out.startswith("Adding stribeck@joint_2 takes the error of joint_2")
    assert f"written: {page}" in done.out
    text = page.read_text(encoding="utf-8")
    assert "<!DOCTYPE html>" in text[:20]
    assert "robot_ident report " in text
    again = run(*words)
    assert again.code == 2
    assert "exists already" in again.err
    found = run(*words, "--force", "--json").json
    assert found["verdict"] == "adequate"
    assert found["bytes"] == page.stat().st_size
    assert [step["added"] for step in found["steps"]] == [[], ["stribeck@joint_2"]]
    assert found["steps"][1]["mse"]["joint_2"] == pytest.approx(findings.last.training["joint_2"].mse)


def test_bad_input_is_told_in_one_line(run: Run, findings: Findings, models: list[Path], tmp_path: Path) -> None:
    bag, page = findings.training[0].path, tmp_path / "report.html"
    for words, told in (
        (["report", bag, "--bag", bag, "-o", page], f"{bag}: not a model"),
        (["report", models[0], "--bag", tmp_path / "none", "-o", page], "none"),
        (["report", models[0], "--bag", bag, "-o", tmp_path / "no" / "page.html"], "does not exist"),
        (["report", models[0], "--bag", bag, "--trajectory", models[0], "-o", page], "model_1.yaml"),
    ):
        done = run(*words)
        assert done.code == 2
        assert told in done.err
        assert len(done.err.strip().splitlines()) == 1
        assert not page.exists()

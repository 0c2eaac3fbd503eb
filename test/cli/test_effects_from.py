"""`--effects-from` works with every verb that knows effects."""

from __future__ import annotations

from pathlib import Path

import pytest

from robot_ident.cli.main import EFFECTLESS, VERBS, build_parser, main
from robot_ident.effects import CATALOGUE


@pytest.mark.parametrize("name", VERBS)
def test_every_verb_that_knows_effects_takes_the_option(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        build_parser(name).parse_args([name, "--help"])
    assert ("--effects-from" in capsys.readouterr().out) == (name not in EFFECTLESS)


def test_an_effect_of_a_file_is_known_to_the_verb(checkout: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = dict(CATALOGUE)
    try:
        assert main(["effects", "tight_spot", "--effects-from", str(checkout / "examples/my_effects.py")]) == 0
        assert "tight spot" in capsys.readouterr().out
    finally:
        for name in set(CATALOGUE) - set(before):
            del CATALOGUE[name]


def test_a_file_that_is_not_there_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["effects", "--effects-from", "nowhere.py"]) == 2
    assert capsys.readouterr().err.strip() == "robot_ident effects: nowhere.py: no such file"

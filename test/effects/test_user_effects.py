"""Effects that users bring in a file of their own, and what `robot_ident effects` prints."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from robot_ident.cli.main import main
from robot_ident.effects import CATALOGUE, load_effects, make_effect, register
from robot_ident.errors import InputError
from robot_ident.model.expressions import columns_function
from robot_ident.model.structure import Structure
from robot_ident.robot import load_robot
from robot_ident.signals.motion import Motion

GOOD = '''
from robot_ident.effects import Coefficient, Effect

class Knock(Effect):
    """A knock."""
    name = "knock"
    equation = "k dq^3"
    meaning = "a knock"
    coefficients = (Coefficient("k", "Nm s^3/rad^3", "N s^3/m^3"),)
    symmetry = "dissipative"
    signature = "at full speed"

    def full_terms(self, x, m):
        return [{self.joint: x.dq[self.joint] ** 3}]
'''


@pytest.fixture(autouse=True)
def untouched_catalogue() -> Iterator[None]:
    before = dict(CATALOGUE)
    yield
    CATALOGUE.clear()
    CATALOGUE.update(before)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "mine.py"
    path.write_text(GOOD)
    return path


def test_the_example_works_in_a_model(checkout: Path) -> None:
    found = load_effects(checkout / "examples/my_effects.py")
    assert list(found) == ["tight_spot"]
    register(found)
    robot = load_robot()
    structure = Structure.build(robot, ["tight_spot@joint_2"])
    assert structure.names[-1] == "tight_spot.level@joint_2"
    motion = Motion(*np.random.default_rng(0).uniform(-1, 1, (3, 20, 3)))
    phi, numeric = columns_function(structure), structure.columns(motion)
    for k in range(motion.samples):
        np.testing.assert_allclose(np.array(phi(motion.q[k], motion.dq[k], motion.ddq[k])), numeric[k], atol=1e-10)


def test_a_file_may_be_loaded_again(file: Path) -> None:
    register(load_effects(file))
    register(load_effects(file))
    assert make_effect("knock@joint_1", load_robot()).label == "knock@joint_1"


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("class Knock", "class Knock("), "line 4"),
        (("    signature =", "    signal ="), "class Knock: signature is missing"),
        (('"knock"', '"viscous"'), "the name 'viscous' is taken"),
        (('"knock"', '"Knock 1"'), "isn't in snake_case"),
        (('"dissipative"', '"odd"'), "symmetry = 'odd'; known: dissipative"),
        (("(Coefficient(", "len(Coefficient("), "line 9: TypeError"),
        (('"Nm s^3/rad^3"', '""'), "coefficient 'k' has no unit"),
        (("def full_terms", "def term"), "neither full_terms nor full_columns"),
        (("class Knock(Effect)", "class Knock"), "defines no subclass"),
        (("import Coefficient", "import Coeficient"), "line 2: ImportError"),
        (('    signature = "at', '    confused_with = ("stribek",)\n    signature = "at'), "unknown effect 'stribek'"),
    ],
)
def test_a_file_that_can_not_be_used_is_one_line(file: Path, change: tuple[str, str], words: str) -> None:
    file.write_text(GOOD.replace(*change))
    with pytest.raises(InputError, match=words) as error:
        load_effects(file)
    assert str(error.value).startswith(str(file))
    assert "\n" not in str(error.value)


def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        load_effects(tmp_path / "none.py")


def test_two_files_may_not_give_one_name_twice(file: Path, tmp_path: Path) -> None:
    register(load_effects(file))
    other = tmp_path / "other.py"
    other.write_text(GOOD)
    with pytest.raises(InputError, match="the name 'knock' is taken"):
        load_effects(other)


def test_the_table_holds_every_effect(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["effects"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines[2:]] == list(CATALOGUE)


@pytest.mark.parametrize("name", sorted(CATALOGUE))
def test_a_page_says_all_about_an_effect(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["effects", name]) == 0
    text = capsys.readouterr().out
    effect = CATALOGUE[name]
    told = [effect.meaning, effect.equation, effect.signature, effect.experiment, effect.magnitude, effect.evidence]
    told += [*effect.confused_with, *effect.also_like, *(c.unit for c in effect.coefficients)]
    told += [i.name for i in effect.inner]
    assert all(word in text for word in told)
    assert main(["effects", name, "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert data["schema"] == "robot_ident/effects/1"
    assert data["effects"][0]["name"] == name
    assert data["effects"][0]["confused_with"] == list(effect.confused_with)


def test_a_users_effect_has_a_page_too(file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["effects", "knock", "--effects-from", str(file)]) == 0
    assert "k dq^3" in capsys.readouterr().out


def test_an_unknown_effect_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["effects", "stribek"]) == 2
    assert "did you mean 'stribeck'" in capsys.readouterr().err

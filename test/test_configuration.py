"""YAML files that no reader may follow: each refused in one line that says where, whoever finds it first."""

from __future__ import annotations

from pathlib import Path

import pytest

from robot_ident.configuration import NotYaml, load_yaml, read_yaml
from robot_ident.errors import LONGEST, InputError, did_you_mean


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a: &x [1]\nb: *x", "line 2: aliases (*x)"),
        ("a: &-x [1]\nb:\n- {c: *-x}", "line 3: aliases (*-x)"),
        ("a: 1\nb: {c: 1, d: 2, c: 3}", "line 2: the key 'c' stands there twice"),
        ("joints:\n  one: {}\n  two: {}\n  one: {}", "line 4: the key 'one' stands there twice"),
        ("a: 1\nb: " + "[" * 200_000, "line 2: "),
        ("a:\n" + "- " * 200_000, "line 2: "),
        ("a: 1\nb: " + "[" * 51 + "]" * 51, "line 2: more than 50 levels"),
        ("a: " + "9" * 5000, "line 1: a number of 5000 characters"),
        ("a: 0x" + "f" * 5000, "line 1: a number of 5002 characters"),
        ("a: 2001-99-99", "not YAML: "),
        ("a: !!int ''", "not YAML: "),
        ("a: !!python/object/apply:os.getcwd []", "not YAML at line 1: "),
        ("a: [1, 2", "not YAML at line 2"),
    ],
)
def test_refused(text: str, message: str) -> None:
    with pytest.raises(NotYaml) as caught:
        load_yaml(text)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_what_people_write_is_read() -> None:
    text = "a: 1e-3\n'*': '*x'\nb:\n- [1, 2]\n- {c: d}\n- {c: e}\nf: " + "g" * 5000
    assert load_yaml(text)["b"] == [[1, 2], {"c": "d"}, {"c": "e"}]
    assert load_yaml("a: &x [1]\nb: *x", aliases=True) == {"a": [1], "b": [1]}


def test_a_number_beyond_all_quantities_is_named_by_its_field(tmp_path: Path) -> None:
    (tmp_path / "a.yaml").write_text("a: 1\nb:\n- c: [0.0, 1.0e+300]\n")
    with pytest.raises(InputError, match=r"b\.0\.c\.1 = 1e\+300: no quantity in these files"):
        read_yaml(tmp_path / "a.yaml")


def test_an_error_is_one_readable_line() -> None:
    error = InputError("joint 'a\n\x1b[31mb\x00' of " + "x" * 10_000)
    assert str(error).isprintable() and len(str(error)) == LONGEST
    many = did_you_mean("q_" * 10_000, [f"name_{k}" for k in range(100_000)])
    assert len(many) < 400

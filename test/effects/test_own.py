"""What goes wrong in a user's effect is one line that names its file and class."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from robot_ident.effects import load_effects
from robot_ident.errors import InputError
from robot_ident.model.expressions import columns_function
from robot_ident.model.structure import Structure
from robot_ident.robot import load_robot
from robot_ident.signals.motion import Motion

SOURCE = """
import numpy as np
from robot_ident.effects import Coefficient, Effect, Inner

class Dent(Effect):
    name = "dent"
    equation = "a exp(-((q - q0) / w)^2 / 2)"
    meaning = "a dent"
    coefficients = (Coefficient("depth", "Nm", "N"),)
    inner = (Inner("q0", "rad", "m", -1.0, 1.0, (0.0, 0.5)),)
    symmetry = "conservative"
    signature = "static in position"

    def full_terms(self, x, m):
        q = x.q[self.joint]
        {body}
"""


@pytest.mark.parametrize(
    ("body", "message"),
    [
        ("raise RuntimeError('boom')", r"dent.py, line 16: class Dent: RuntimeError: boom"),
        ("raise SystemExit(7)", r"class Dent: SystemExit: 7"),
        ("return None", r"class Dent: TypeError"),
        ("return [{self.joint: q[:7]}]", r"class Dent: ValueError: could not broadcast"),
        ("return [{self.joint: q * np.nan}]", r"class Dent: a column that is not finite at q0 = 0.5"),
        ("return [{self.joint: q * 1e308 * 10}]", r"class Dent: a column that is not finite"),
        ("return [{self.joint: q * 1j}]", r"class Dent: ComplexWarning"),
        ("return [{self.joint: q}, {self.joint: q}]", r"columns of shape \(40, 3, 2\) at q0 = 0.5, not \(40, 3, 1\)"),
    ],
)
def test_its_columns(tmp_path: Path, body: str, message: str) -> None:
    path = tmp_path / "dent.py"
    path.write_text(SOURCE.replace("{body}", body))
    effect = load_effects(path)["dent"](load_robot("kuka_ir361"), 0)
    q = np.random.default_rng(1).standard_normal((40, 3))
    with pytest.raises(InputError, match=message):
        effect.columns(Motion(q, q, q))


def test_a_torque_that_is_not_known_yet_makes_no_error(tmp_path: Path) -> None:
    """An estimate begins at zero torque, where a direction of the load is 0 / 0."""
    path = tmp_path / "dent.py"
    body = "return [{self.joint: x.load[self.joint] / np.sqrt(x.load[self.joint] ** 2)}]"
    text = SOURCE.replace("{body}", body).replace("    inner =", "    uses_torque = True\n    inner =")
    path.write_text(text)
    structure = Structure.build(load_robot("kuka_ir361"), [load_effects(path)["dent"](load_robot("kuka_ir361"), 0)])
    motion = Motion(*np.random.default_rng(1).uniform(-1.0, 1.0, (3, 40, 3)))
    np.testing.assert_array_equal(structure.columns(motion)[:, :, -1], 0.0)
    known = structure.columns(motion, np.ones(len(structure.parameters)))
    np.testing.assert_array_equal(np.abs(known[:, 0, -1]), 1.0)
    with pytest.raises(InputError, match="a column that is not finite"):
        structure.columns(motion, np.zeros(len(structure.parameters)))


def test_what_no_expression_has_is_told(tmp_path: Path) -> None:
    """Designs and exports give an effect CasADi's functions, not all of numpy's."""
    path = tmp_path / "dent.py"
    path.write_text(SOURCE.replace("{body}", "return [{self.joint: m.where(q > 0.5, q, 0.0)}]"))
    structure = Structure.build(load_robot("kuka_ir361"), [load_effects(path)["dent"](load_robot("kuka_ir361"), 0)])
    with pytest.raises(InputError, match="dent.py, line 16: class Dent: AttributeError: .* no attribute 'where'"):
        columns_function(structure)


def test_one_that_is_right_is_left_alone(tmp_path: Path) -> None:
    path = tmp_path / "dent.py"
    path.write_text(SOURCE.replace("{body}", "return [{self.joint: np.exp(-((q - self.setting['q0']) ** 2))}]"))
    q = np.random.default_rng(1).standard_normal((40, 3))
    made = load_effects(path)["dent"](load_robot("kuka_ir361"), 0).columns(Motion(q, q, q))
    np.testing.assert_allclose(made[:, 0, 0], np.exp(-((q[:, 0] - 0.5) ** 2)))


def test_a_file_that_ends_the_program(tmp_path: Path) -> None:
    path = tmp_path / "leaves.py"
    path.write_text("raise SystemExit(5)\n")
    with pytest.raises(InputError, match=r"leaves.py, line 1: SystemExit: 5"):
        load_effects(path)


def test_what_it_prints_goes_to_standard_error(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Standard output is one JSON object's, or a table's."""
    path = tmp_path / "dent.py"
    body = "print('its columns'); return [{self.joint: q}]"
    path.write_text("print('loaded')\n" + SOURCE.replace("{body}", body))
    q = np.random.default_rng(1).standard_normal((40, 3))
    load_effects(path)["dent"](load_robot("kuka_ir361"), 0).columns(Motion(q, q, q))
    printed = capsys.readouterr()
    assert printed.out == ""
    assert "loaded" in printed.err
    assert "its columns" in printed.err

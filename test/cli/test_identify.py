"""`identify` as users call it: what it promises can be seen by commands."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from robot_ident.bags import write_recording
from robot_ident.cli.identify import to_the_digit
from robot_ident.cli.main import build_parser
from robot_ident.cli.values import bags_of
from robot_ident.errors import InputError
from robot_ident.estimation.physical_consistency import violations
from robot_ident.model.model import Model
from robot_ident.recording import Recording

Run = Callable[..., Any]

TABLE_1 = {"p11": 8.21, "p15": 7.63}  # as printed; all else is the robot's own


def test_parameters_are_printed_to_the_digit_that_is_known() -> None:
    """A wrist's inertia is 1e-4 kg m^2; four decimals would show nothing of it."""
    assert to_the_digit(45.7294123, 0.35449) == ("45.7294", "0.3545")
    assert to_the_digit(-0.00052634, 0.0000212) == ("-0.000526", "0.000021")
    assert to_the_digit(4.21748e-5, 5.53e-9) == ("4.21748e-05", "5.5e-09")
    assert to_the_digit(1.5, 0.0) == ("1.5000", "0.0000")
    assert to_the_digit(1.5, np.inf) == ("1.5000", "inf")


def test_a_recording_through_the_filter_gives_the_same_parameters(run: Run, excitation: Path, tmp_path: Path) -> None:
    """The same seed: within .3 sigma, as .1 is what noise beyond the filter's band is worth."""
    models = []
    for name, words, undone in (("plain", [], "none"), ("filtered", ["--anti-alias"], "8:40")):
        bag, model = tmp_path / name, tmp_path / f"{name}.yaml"
        assert run("simulate", excitation, "--periods", "8", "--seed", "3", *words, "-o", bag).code == 0
        assert run("identify", bag, "--anti-alias", undone, "-o", model).code == 0
        models.append(Model.read(model))
    plain, filtered = models
    assert np.abs((filtered.values - plain.values) / plain.std).max() < 0.3
    np.testing.assert_allclose(filtered.std, plain.std, rtol=0.1)


def test_table_1_is_named_as_impossible_and_mended(run: Run, arm: Any, tmp_path: Path) -> None:
    t = np.arange(6000) / 150.0
    motion = arm.series.motion(t)
    values = arm.structure.true_values().copy()
    for name, value in TABLE_1.items():
        values[arm.structure.names.index(name)] = value
    noise = np.random.default_rng(0).normal(size=(6000, 3))
    bag, rough, mended = (tmp_path / name for name in ("table_1.npz", "rough.yaml", "mended.yaml"))
    write_recording(bag, Recording(arm.robot.joints, t, motion.q, arm.structure.columns(motion) @ values + noise))
    assert run("identify", bag, "-o", rough).code == 0
    refused = run("export", rough, "--urdf", tmp_path / "rough.urdf")
    assert refused.code == 2
    assert "p15 >= p11 does not hold" in refused.err
    assert "--physical" in refused.err
    assert not (tmp_path / "rough.urdf").exists()
    done = run("identify", bag, "--physical", "-o", mended)
    assert done.code == 0
    assert "not physically possible as estimated: p15 >= p11 does not hold" in done.err
    model = Model.read(mended)
    assert violations(model.structure, model.linear) == ()
    assert run("export", mended, "--urdf", tmp_path / "mended.urdf").code == 0
    assert "<inertial>" in (tmp_path / "mended.urdf").read_text()


def test_exports_as_scripts_use_them(run: Run, bag: Path, tmp_path: Path) -> None:
    model = tmp_path / "model.yaml"
    assert run("identify", bag, "--physical", "--effect", "torque_offset@joint_1", "-o", model).code == 0
    done = run("export", model, "--mjcf", tmp_path / "arm.xml", "--validation", bag, "--json")
    assert done.code == 0
    (left,) = done.json["left_out"]
    assert left["effect"] == "torque_offset@joint_1"
    assert set(left["rms"]) == {"joint_1", "joint_2", "joint_3"}
    assert left["rms"]["joint_2"] == 0.0
    assert run("export", model, "--mjcf", tmp_path / "arm.xml").code == 2
    code = tmp_path / "code"
    assert run("export", model, "--c", code).code == 0
    assert sorted(file.name for file in code.iterdir()) == ["kuka_ir361.c", "kuka_ir361.h"]
    assert run("export", model, "--c", code).code == 2
    assert run("export", model, "--c", code, "--force").code == 0
    assert run("export", model).code == 2
    assert run("export", bag, "--urdf", tmp_path / "x.urdf").code == 2


def test_several_effects_after_one_option(bag: Path) -> None:
    def told(*words: str) -> tuple[list[str], list[str]]:
        args = build_parser("identify").parse_args(["identify", *words])
        return bags_of(args), args.effect

    a, b, one = "torque_offset@joint_1", "torque_offset@joint_2", str(bag)
    assert told(one, "--effect", a, b) == ([one], [a, b])
    assert told(one, "--effect", a, "--effect", b, "-o", "model.yaml") == ([one], [a, b])
    assert told("--effect", a, b, one) == ([one], [a, b]), "a recording stays one behind them"
    assert told("--robot", "kuka_ir361", one, "--effect", a) == ([one], [a])
    with pytest.raises(InputError, match="BAG"):
        told("--effect", a)


def test_what_comes_before_the_processing_is_to_be_mended(run: Run, checkout: Path) -> None:
    """As docs/your_robot.md says it of the lines that `identify` prints."""
    inputs, line = checkout / "test/golden/inputs", "base model by prediction"
    told = run("identify", inputs / "six_axis_pass.npz", "--robot", inputs / "six_axis.yaml")
    assert told.code == 0
    before = told.err.partition(line)[0].splitlines()
    assert line in told.err
    assert all(one.startswith(("not usable", "the data cannot give", "condition number")) for one in before)
    assert f"`{line} ...`" in (checkout / "docs/your_robot.md").read_text(encoding="utf-8")

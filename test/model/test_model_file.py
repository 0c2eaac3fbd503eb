"""model.yaml: read back to the last digit; what can't be right in it is named."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from robot_ident.cli.identify import parameter_table
from robot_ident.errors import InputError
from robot_ident.estimation.identify import identify
from robot_ident.estimation.solve import ESTIMATORS
from robot_ident.model.model_file import ModelFile, ProcessingFile, read_model, write_model
from robot_ident.recording import Processing


@pytest.fixture(scope="module")
def written(arm: Any, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("model") / "model.yaml"
    write_model(identify([arm.record(3, periods=4)], arm.robot, physical=True), path)
    return path


def test_what_is_read_is_what_was_written(arm: Any, written: Path) -> None:
    model, again = identify([arm.record(3, periods=4)], arm.robot, physical=True), read_model(written)
    np.testing.assert_array_equal(again.values, model.values)
    np.testing.assert_array_equal(again.covariance, model.covariance)
    assert again.physical == model.physical
    assert again.notes == model.notes
    assert Processing(**again.processing) == Processing()


def test_the_files_words_are_the_programs() -> None:
    estimator = ModelFile.model_fields["estimator"].annotation
    assert set(estimator.__args__) == set(ESTIMATORS)  # type: ignore[union-attr]
    assert set(ProcessingFile.model_fields) == set(Processing.__dataclass_fields__)


def broken(data: dict[str, Any], change: Callable[[dict[str, Any]], object]) -> str:
    change(data)
    return yaml.safe_dump(data)


CHANGES: dict[str, Callable[[dict[str, Any]], object]] = {
    "estimator = 'wsl'": lambda d: d.update(estimator="wsl"),
    "processing.decimate = 0": lambda d: d["processing"].update(decimate=0),
    "processing.decimate = 100000": lambda d: d["processing"].update(decimate=100_000),
    "processing.low_pass = -3": lambda d: d["processing"].update(low_pass=-3),
    "processing.base_frequency = 1000000000": lambda d: d["processing"].update(base_frequency=1e9),
    "unknown key 'processing.filter'": lambda d: d["processing"].update(filter=3),
    "processing.minimum_speed must have 3 values": lambda d: d["processing"].update(minimum_speed=[0.1]),
    "covariance must be 21 x 21": lambda d: d["covariance"].pop(),
    "the variance of p2 is negative": lambda d: d["covariance"][1].__setitem__(1, -1.0),
    "covariance is not symmetric": lambda d: d["covariance"][0].__setitem__(3, 7.0),
    "noise_covariance must be 21 x 21": lambda d: d.update(noise_covariance=[[1.0, 0.0], [0.0]]),
    "noise_covariance: the variance of p1 is negative": lambda d: d.update(noise_covariance=(-np.eye(21)).tolist()),
    "p1: std 9 is not the root of its variance": lambda d: d["parameters"][0].update(std=9.0),
    "residual is of elbow, joint_1, joint_2": lambda d: d["residual"].update(elbow=d["residual"].pop("joint_3")),
    "noise.torque_variance must have 3 values": lambda d: d["noise"]["torque_variance"].pop(),
    "physical.inertias.joint_2 must hold m, mx": lambda d: d["physical"]["inertias"]["joint_2"].pop("Ixy"),
    "physical.covariance = 'none'": lambda d: d["physical"].update(covariance="none"),
    "its parameters are not those of robot kuka_ir361": lambda d: d["parameters"][0].update(name="p99"),
    "parameters.0.unit = 'furlong': of p1 it is 'kg m^2'": lambda d: d["parameters"][0].update(unit="furlong"),
    "parameters.16.joint = 'joint_3': of viscous@joint_2 it is 'joint_2'": lambda d: d["parameters"][16].update(
        joint="joint_3"
    ),
    "parameters.18.effect = 'viscous'": lambda d: d["parameters"][18].update(effect="viscous"),
    "effects lacks coulomb@joint_3": lambda d: d["effects"].remove("coulomb@joint_3"),
    "noise.torque_variance.1 = 0": lambda d: d["noise"]["torque_variance"].__setitem__(1, 0.0),
    "chi_square = -1": lambda d: d.update(chi_square=-1.0),
    "dof = 0": lambda d: d.update(dof=0),
    "recordings = []": lambda d: d.update(recordings=[]),
    "recordings.0.reach: 'joint_9' is no joint": lambda d: d["recordings"][0]["reach"].update(joint_9=[0.0, 1.0, 1.0]),
    "recordings.0.reach.joint_1 = [2, ": lambda d: d["recordings"][0]["reach"].update(joint_1=[2.0, 1.0, 1.0]),
    "recordings.0.taken_as = 'guess'": lambda d: d["recordings"][0].update(taken_as="guess"),
    "parameters.4.value = inf": lambda d: d["parameters"][4].update(value=float("inf")),
}


@pytest.mark.parametrize("message", CHANGES)
def test_what_cannot_be_is_refused_in_one_line(written: Path, tmp_path: Path, message: str) -> None:
    path = tmp_path / "broken.yaml"
    path.write_text(broken(yaml.safe_load(written.read_text()), CHANGES[message]))
    with pytest.raises(InputError, match=re.escape(message)) as caught:
        read_model(path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(("name", "value"), [("vs", -1.0), ("vs", 1e9), ("d", 7.0)])
def test_an_inner_parameter_beyond_its_bounds_is_refused(arm: Any, tmp_path: Path, name: str, value: float) -> None:
    path, data = tmp_path / "model.yaml", identify([arm.record(3, periods=4)], arm.robot, effects=["stribeck@joint_1"])
    write_model(data, path)
    read = yaml.safe_load(path.read_text())
    next(p for p in read["parameters"] if p["name"] == f"stribeck.{name}@joint_1").update(value=value)
    path.write_text(yaml.safe_dump(read))
    with pytest.raises(InputError, match=rf"stribeck.{name}@joint_1 = .* lies outside \["):
        read_model(path)


@pytest.mark.parametrize("share", [0.1, 0.5, 0.9])
def test_a_file_that_breaks_off_is_refused(written: Path, tmp_path: Path, share: float) -> None:
    path, text = tmp_path / "cut.yaml", written.read_text()
    path.write_text(text[: int(share * len(text))])
    with pytest.raises(InputError, match="cut.yaml") as caught:
        read_model(path)
    assert "\n" not in str(caught.value)


def test_a_parameter_at_its_bound_has_no_sigma(arm: Any, tmp_path: Path) -> None:
    """Whatever is refined ends at a bound where data call for more: its covariance tells nothing then."""
    model = identify([arm.record(3, periods=4)], arm.robot, effects=["stribeck@joint_1"])
    told = {}
    for vs, d in ((0.1, 1.0), (0.8, 2.0), (0.0005, 0.5)):
        structure = model.structure.with_settings([vs, d])
        values = np.concatenate([model.linear, [vs, d]])
        moved = replace(model, structure=structure, values=values)
        rows = {p["name"]: p for p in moved.to_dict()["parameters"]}
        told[vs] = [rows[f"stribeck.{name}@joint_1"] for name in ("vs", "d")]
        path = tmp_path / f"{vs}.yaml"
        write_model(moved, path)
        assert read_model(path).at_bound == moved.at_bound
    assert [p["at_bound"] for p in told[0.1]] == [False, False]
    assert all(p["std"] is not None for p in told[0.1])
    for vs in (0.8, 0.0005):
        assert [(p["std"], p["at_bound"]) for p in told[vs]] == [(None, True), (None, True)]
    assert "at its bound" in parameter_table(moved)

"""The file `excitation.yaml`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from robot_ident.errors import InputError
from robot_ident.robot import Robot
from robot_ident.trajectories.excitation import Excitation

TEXT = """schema: robot_ident/excitation/1
robot: arm
joints: [one, two]
base_frequency: 0.1
sample_rate: 150
harmonics: 2
q0: [0, 0.5]
a: [[0.1, 0.2], [0.3, 0.4]]
b: [[1, 2], [3, 4]]
"""


def written(folder: Path, text: str) -> Path:
    path = folder / "excitation.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def test_harmonics_beyond_any_memory_are_refused(tmp_path: Path) -> None:
    many = [[0.0] * 1001] * 2
    text = TEXT.replace("harmonics: 2", "harmonics: 1001").replace("base_frequency: 0.1", "base_frequency: 0.01")
    text = text.replace("[[0.1, 0.2], [0.3, 0.4]]", str(many)).replace("[[1, 2], [3, 4]]", str(many))
    with pytest.raises(InputError, match="1001 harmonics are too many"):
        Excitation.read(written(tmp_path, text))


def test_reading_gives_the_numbers_that_were_written(
    tmp_path: Path, random_excitation: Callable[..., Excitation]
) -> None:
    before = random_excitation(7)
    path = tmp_path / "excitation.yaml"
    before.write(path)
    after = Excitation.read(path)
    for name in ("q0", "a", "b"):
        assert np.array_equal(getattr(after.series, name), getattr(before.series, name)), name
    assert (after.robot, after.joints, after.sample_rate) == (before.robot, before.joints, before.sample_rate)


def test_what_a_file_says_of_its_origin_is_kept(tmp_path: Path) -> None:
    origin = "criterion: d-optimal\nachieved: {log10_det_covariance: -50.5}\nreproduce: {seed: 3}\n"
    excitation = Excitation.read(written(tmp_path, TEXT + origin))
    assert excitation.criterion == "d-optimal"
    excitation.write(tmp_path / "copy.yaml")
    assert Excitation.read(tmp_path / "copy.yaml").achieved == {"log10_det_covariance": -50.5}


def test_period_arithmetic(tmp_path: Path) -> None:
    excitation = Excitation.read(written(tmp_path, TEXT))
    assert excitation.samples_per_period == 1500
    assert excitation.period == 10.0
    t = excitation.times()
    assert len(t) == 1500
    assert t[-1] + 1 / 150 == pytest.approx(10.0)
    assert excitation.samples().q.shape == (1500, 2)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("q0: [0, 0.5]", "q0: [0]", "q0 has 1 numbers for 2 joints"),
        ("[0.3, 0.4]]", "[0.3]]", "a of two has 1 numbers for 2 harmonics"),
        ("[3, 4]]", "[3, 4], [5, 6]]", "b has 3 rows for 2 joints"),
        ("sample_rate: 150", "sample_rate: 150.05", "whole number"),
        ("sample_rate: 150", "sample_rate: 0.4", "2 harmonics of 0.1 Hz need a sample rate above 0.4 Hz"),
        ("harmonics: 2", "harmonics: 0", "harmonics"),
        ("q0: [0, 0.5]", "q0: [0, .nan]", "q0"),
        ("[one, two]", "[one, one]", "once"),
        ("robot: arm", "robbot: arm", "robot"),
        ("excitation/1", "model/1", "schema"),
    ],
)
def test_a_file_that_is_wrong_is_refused_by_field(tmp_path: Path, old: str, new: str, message: str) -> None:
    assert old in TEXT
    path = written(tmp_path, TEXT.replace(old, new))
    with pytest.raises(InputError, match=message) as caught:
        Excitation.read(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_every_problem_is_told_at_once(tmp_path: Path) -> None:
    path = written(tmp_path, TEXT.replace("q0: [0, 0.5]", "q0: [0]").replace("sample_rate: 150", "sample_rate: 151.11"))
    with pytest.raises(InputError, match="q0 has 1.*whole number"):
        Excitation.read(path)


def test_a_trajectory_of_another_robot_is_refused(tmp_path: Path, kuka: Robot) -> None:
    with pytest.raises(InputError, match="trajectory of another robot.*one, two.*joint_1.*--robot"):
        Excitation.read(written(tmp_path, TEXT)).check_robot(kuka)


def test_a_robot_of_the_package_takes_no_motion_of_an_arm_that_is_not(
    kuka: Robot, random_excitation: Callable[..., Excitation]
) -> None:
    excitation = random_excitation(0)
    with pytest.raises(InputError, match="it is for 'my_arm'"):
        replace(excitation, robot="my_arm").check_robot(kuka)
    replace(excitation, robot="kuka_ir361_spring").check_robot(kuka)

"""Input that would give a wrong number is refused or named first, by `identify`, `diagnose` and `info` alike."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from contextlib import redirect_stdout
from functools import cache
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from robot_ident.cli.main import main
from robot_ident.model.model_file import read_model

Run = Callable[..., Any]
Arrays = dict[str, Any]


@pytest.fixture(scope="module")
def golden(checkout: Path) -> Path:
    return checkout / "test/golden/inputs"


@pytest.fixture(scope="module")
def fitted(golden: Path, tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Path]:
    """Return a function that gives the model of sound recordings, as `identify` writes it; made once."""
    folder = tmp_path_factory.mktemp("models")

    @cache
    def model(*names: str) -> Path:
        file: Path = folder / f"{'_'.join(names)}.yaml"
        assert main(["identify", *(str(golden / f"{name}.npz") for name in names), "-o", str(file)]) == 0
        return file

    return model


@pytest.fixture
def base(golden: Path) -> Arrays:
    return dict(np.load(golden / "kuka_1.npz"))


@pytest.fixture(scope="module")
def verdict(golden: Path, fitted: Callable[..., Path]) -> str:
    """Return what a diagnosis says first of a sound recording."""
    model = fitted("kuka_1")
    with redirect_stdout(StringIO()) as out:
        assert main(["diagnose", str(model), str(golden / "kuka_1.npz")]) == 0
    return out.getvalue().splitlines()[0]


def noise(arrays: Arrays) -> Arrays:
    random = np.random.default_rng(1)
    return {**arrays, "tau": random.normal(size=arrays["tau"].shape) * arrays["tau"].std(axis=0)}


def absolute(arrays: Arrays) -> Arrays:
    return {**arrays, "tau": np.abs(arrays["tau"])}


def twice(arrays: Arrays) -> Arrays:
    return {**arrays, "tau": arrays["tau"][:, [0, 2, 2]]}


def six_columns(arrays: Arrays) -> Arrays:
    twofold = {key: np.hstack([arrays[key], arrays[key][:, ::-1]]) for key in ("q", "tau")}
    return {"t": arrays["t"], **twofold}


def interpolated(arrays: Arrays) -> Arrays:
    t = np.arange(arrays["t"][0], arrays["t"][-1], 1 / 1500)
    finer = {key: np.column_stack([np.interp(t, arrays["t"], x) for x in arrays[key].T]) for key in ("q", "tau")}
    return {"t": t, "names": arrays["names"], **finer}


SPOILED = {
    noise: "not made by the motion",
    absolute: "absolute values",
    twice: "the effort of joint_3 is that of joint_2",
    six_columns: "6 columns and no names",
    interpolated: "interpolated from about 100 Hz",
}


@pytest.mark.parametrize("spoil", list(SPOILED), ids=lambda spoil: spoil.__name__)
def test_recordings(
    run: Run, fitted: Callable[..., Path], base: Arrays, tmp_path: Path, spoil: Callable[[Arrays], Arrays]
) -> None:
    words = SPOILED[spoil]
    bad, model = tmp_path / "bad.npz", tmp_path / "model.yaml"
    np.savez(bad, **spoil(base))
    refused = run("identify", bad, "-o", model)
    assert refused.code == 2 and words in refused.err.splitlines()[-1] and not model.exists()
    model = fitted("kuka_1")
    refused = run("diagnose", model, bad)
    assert refused.code == 2 and words in refused.err.splitlines()[-1] and refused.out == ""
    refused = run("report", model, "--bag", bad, "-o", tmp_path / "report.html")
    assert refused.code == 2 and words in refused.err.splitlines()[-1] and not (tmp_path / "report.html").exists()
    told = run("info", bad, "--robot", "kuka_ir361")
    assert words in told.err


def test_every_second_row_beside_the_recording(run: Run, golden: Path, base: Arrays, tmp_path: Path) -> None:
    half = {key: x if key == "names" else x[::2] for key, x in base.items()}
    np.savez(tmp_path / "half.npz", **half)
    refused = run("identify", golden / "kuka_1.npz", tmp_path / "half.npz")
    assert refused.code == 2 and "holds the samples of" in refused.err


def test_the_trajectory_of_another_motion(run: Run, golden: Path) -> None:
    refused = run("identify", golden / "kuka_1.npz", "--trajectory", golden / "excitation_2.yaml")
    assert refused.code == 2 and "not the motion of the trajectory" in refused.err
    assert run("identify", golden / "kuka_1.npz", "--trajectory", golden / "excitation_1.yaml").code == 0


def test_the_trajectory_of_every_recording(run: Run, golden: Path) -> None:
    """Two motions are what a diagnosis wants: each names its own."""
    bags = [golden / "kuka_1.npz", golden / "kuka_2.npz"]
    own = [word for k in (1, 2) for word in ("--trajectory", golden / f"excitation_{k}.yaml")]
    known = run("identify", *bags, *own)
    assert known.code == 0 and "time scale not verified" not in known.err
    assert "time scale not verified" in run("identify", *bags).err
    crossed = run("identify", *bags[::-1], *own)
    assert crossed.code == 2 and "not the motion of the trajectory" in crossed.err
    assert run("identify", *bags, *own, *own[:2]).code == 2


@pytest.mark.parametrize("gravity", ["[0, 0, 9.81]", "[0, 0, -1.62]"])
def test_another_gravity(run: Run, golden: Path, checkout: Path, tmp_path: Path, gravity: str) -> None:
    robots = checkout / "config/robots"
    shutil.copy(robots / "kuka_ir361.urdf", tmp_path)
    text = (robots / "kuka_ir361.yaml").read_text()
    (tmp_path / "robot.yaml").write_text(text.replace("[0, 0, -9.81]", gravity))
    bag, robot, model = golden / "kuka_1.npz", tmp_path / "robot.yaml", tmp_path / "model.yaml"
    refused = run("identify", bag, "--robot", robot)
    assert refused.code == 2 and "change it to 'gravity: [0, 0, -9.81]'" in refused.err
    assert f"robot.yaml:{text[: text.index('gravity:')].count(chr(10)) + 1}:" in refused.err
    assert "weight is that of" in run("info", bag, "--robot", robot).err
    assert run("identify", bag, "--robot", robot, "--as-declared", "-o", model).code == 0
    kept = model.read_text()
    model.write_text(kept.replace("; taken as declared", ""))
    refused = run("diagnose", model, bag)
    assert refused.code == 2 and "gravity" in refused.err


@pytest.mark.parametrize(
    ("length", "words"),
    [('xyz="0.480 0 0"', "joint_3 lies 480 m"), ('xyz="-0.2431 -0.0222 0.0227"', "the centre of mass behind joint_2")],
)
def test_a_length_in_millimetres(
    run: Run, golden: Path, checkout: Path, tmp_path: Path, length: str, words: str
) -> None:
    robots = checkout / "config/robots"
    shutil.copy(robots / "kuka_ir361.yaml", tmp_path / "robot.yaml")
    text = (robots / "kuka_ir361.urdf").read_text()
    longer = " ".join(f"{1000 * float(word):g}" for word in length[5:-1].split())
    (tmp_path / "kuka_ir361.urdf").write_text(text.replace(length, f'xyz="{longer}"'))
    refused = run("identify", golden / "kuka_1.npz", "--robot", tmp_path / "robot.yaml")
    assert refused.code == 2 and words in refused.err and "millimetres" in refused.err


def test_a_clock_that_runs_a_tenth_slow(run: Run, arm: Any, tmp_path: Path) -> None:
    recording, slow, model = arm.record(1, periods=4, lead=0.0), tmp_path / "slow.npz", tmp_path / "model.yaml"
    np.savez(slow, t=0.9 * recording.t, q=recording.q, tau=recording.tau, names=np.array(recording.names))
    told = run("identify", slow, "-o", model)
    assert told.code == 0 and "clock runs 1.1" in told.err.splitlines()[0]
    assert "clock runs 1.1" in run("diagnose", model, slow).out.splitlines()[0]
    assert any("time scale not verified" in line for line in told.err.splitlines())


def test_a_load_that_is_to_be_found_is_no_wrong_gain(run: Run, golden: Path, tmp_path: Path) -> None:
    for name in ("six_axis.yaml", "six_axis.urdf", "hand_empty.npz", "hand_loaded.npz"):  # and no sidecar
        shutil.copy(golden / name, tmp_path)
    model = tmp_path / "model.yaml"
    words = ("identify", tmp_path / "hand_empty.npz", "--robot", tmp_path / "six_axis.yaml", "-o", model)
    assert run(*words).code == 0
    found = run("identify", tmp_path / "hand_loaded.npz", "--only", "payload", "--model", model)
    assert found.code == 0 and "2.49" in found.out, found.err


def test_validation_on_what_was_fitted_says_so_first(run: Run, golden: Path, fitted: Callable[..., Path]) -> None:
    bag, model = golden / "kuka_1.npz", fitted("kuka_1")
    assert "fitted to it, so it validates nothing" in run("validate", model, bag).err.splitlines()[0]
    assert "validates nothing" not in run("validate", model, golden / "kuka_2.npz").err


@pytest.mark.parametrize("kind", ["shifted in time", "a part", "single precision", "a little noise"])
def test_validation_on_what_is_a_copy_in_disguise(
    run: Run, golden: Path, fitted: Callable[..., Path], tmp_path: Path, kind: str
) -> None:
    model, bag, copy = fitted("kuka_1", "kuka_2"), golden / "kuka_1.npz", tmp_path / "copy.npz"
    a = {key: x for key, x in np.load(bag).items() if key != "dq"}
    if kind == "shifted in time":
        a["t"] = a["t"] + 3600.0
    elif kind == "a part":
        a = {key: x if key == "names" else x[137:] for key, x in a.items()}
    elif kind == "single precision":
        a |= {key: a[key].astype(np.float32) for key in ("q", "tau")}
    else:
        a["tau"] = a["tau"] + np.random.default_rng(0).normal(0.0, 0.01, a["tau"].shape)
    np.savez(copy, **a)
    done = run("validate", model, copy)
    assert done.code == 0 and "so it validates nothing" in done.err.splitlines()[0]
    page = run("report", model, "--bag", bag, "--validation", copy, "-o", tmp_path / "page.html")
    assert page.code == 2 and "the samples of" in page.err


@pytest.mark.parametrize("joints", [pytest.param(slice(None), marks=pytest.mark.long), slice(1, 2)], ids=["all", "one"])
def test_positions_that_leap_and_come_back_are_left_out(
    run: Run, base: Arrays, fitted: Callable[..., Path], verdict: str, tmp_path: Path, joints: slice
) -> None:
    q = base["q"].copy()
    q[2000:2003, joints] = 0.0
    bad, model = tmp_path / "bad.npz", fitted("kuka_1")
    np.savez(bad, **{**base, "q": q})
    told = run("identify", bad, "--json").json
    assert any("leap by up to" in note and "3 samples, first at" in note for note in told["notes"])
    plain = read_model(model)
    for one, parameter, value in zip(told["parameters"], plain.parameters, plain.values, strict=True):
        assert one["name"] == parameter.name and abs(one["value"] - value) < one["std"]
    found = run("diagnose", model, bad)
    assert found.code == 0, found.err
    assert found.out.splitlines()[0] == verdict
    assert "leap by up to" in run("info", bad).err

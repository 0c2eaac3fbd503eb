"""Bad input gets one clear line and exit code 2, and nothing is written."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from robot_ident.bags import BagWriter, Topic, write_recording

Run = Callable[..., Any]


def refused(outcome: Any, *words: str) -> None:
    """Check that a verb was refused with one line that holds the words."""
    assert outcome.code == 2, outcome.err
    lines = [line for line in outcome.err.splitlines() if line.startswith("robot_ident ")]
    assert len(lines) == 1, outcome.err
    assert "Traceback" not in outcome.err
    assert outcome.out == ""
    for word in words:
        assert word in lines[0], lines[0]


def test_a_library_that_the_system_lacks_is_one_line(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    def lacking(args: object) -> int:
        raise ImportError("libgomp.so.1: cannot open shared object file: No such file or directory")

    monkeypatch.setattr("robot_ident.cli.check.run", lacking)
    refused(run("check", "excitation.yaml"), "libgomp.so.1", "apt-get install libgomp1")


def _write(path: Path, recording: Any, **change: Any) -> Path:
    arrays = {"t": recording.t, "q": recording.q, "tau": recording.tau, "names": np.array(recording.names), **change}
    np.savez(path, **arrays)
    return path


def test_missing_joint(run: Run, arm: Any, tmp_path: Path) -> None:
    r = arm.record(1, periods=2)
    path = _write(tmp_path / "r.npz", r, names=np.array(["joint_1", "joint_2", "elbow"]))
    refused(run("identify", path, "-o", tmp_path / "m.yaml"), "r.npz", "'joint_3' is missing", "elbow")
    assert not (tmp_path / "m.yaml").exists()


def test_recordings_of_another_robot_are_not_taken_for_the_default_ones(run: Run, arm: Any, tmp_path: Path) -> None:
    r = arm.record(1, periods=2)
    more = replace(
        r, names=(*r.names, "joint_4"), q=np.hstack([r.q, r.q[:, :1]]), tau=np.hstack([r.tau, r.tau[:, :1]]), dq=None
    )
    write_recording(tmp_path / "six.npz", more)
    refused(run("identify", tmp_path / "six.npz", "-o", tmp_path / "m.yaml"), "six.npz", "joint_4", "--robot")


def test_nan_samples(run: Run, arm: Any, tmp_path: Path) -> None:
    r = arm.record(1, periods=2)
    tau = np.array(r.tau)
    tau[100:105, 1] = np.nan
    refused(run("identify", _write(tmp_path / "r.npz", r, tau=tau)), "tau", "not a number", "5 of")


def test_degrees(run: Run, arm: Any, tmp_path: Path) -> None:
    r = arm.record(1, periods=2)
    refused(run("identify", _write(tmp_path / "r.npz", r, q=np.degrees(r.q))), "degrees instead of radians", "limit")


def test_empty_bag(run: Run, tmp_path: Path) -> None:
    with BagWriter(tmp_path / "empty", [Topic("/joint_states", "sensor_msgs/msg/JointState")]):
        pass
    refused(run("identify", tmp_path / "empty"), "empty")


def test_bag_of_another_topic_lists_what_is_there(run: Run, tmp_path: Path) -> None:
    with BagWriter(tmp_path / "other", [Topic("/chatter", "std_msgs/msg/String")]) as bag:
        bag.write("/chatter", b"\x00\x01\x00\x00\x03\x00\x00\x00hi\x00", 1, 1)
    refused(run("identify", tmp_path / "other"), "/chatter", "std_msgs/msg/String")


def test_truncated_mcap_is_used_and_its_loss_said(run: Run, bag: Path, tmp_path: Path) -> None:
    (file,) = bag.glob("*.mcap")
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(file.read_bytes()[: file.stat().st_size * 4 // 5])
    done = run("identify", cut)
    assert done.code == 0, done.err
    assert "cut.mcap" in done.err
    assert any(word in done.err for word in ("breaks off", "truncated", "cut"))


def test_trajectory_of_another_robot(run: Run, bag: Path, excitation: Path, tmp_path: Path) -> None:
    file = yaml.safe_load(excitation.read_text())
    file["joints"] = ["a1", "a2", "a3"]
    file["robot"] = "other"
    path = tmp_path / "other.yaml"
    path.write_text(yaml.safe_dump(file))
    refused(run("identify", bag, "--trajectory", path), "other")


def test_fewer_than_two_periods(run: Run, arm: Any, excitation: Path, tmp_path: Path) -> None:
    r = arm.record(1, periods=2, lead=0.0)[slice(0, 2000)]
    path = _write(tmp_path / "short.npz", r)
    refused(run("identify", path, "--trajectory", excitation), "short.npz", "at least 2")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["identify", "nothing_there"], "nothing_there"),
        (["identify", "BAG", "--robot", "kuka_ir36"], "did you mean 'kuka_ir361'"),
        (["identify", "BAG", "--effect", "viscus@joint_1"], "did you mean 'viscous'"),
        (["identify", "BAG", "--estimator", "lss"], "unknown estimator"),
        (["identify", "BAG", "--low-pass", "80"], "half the sample rate"),
        (["identify", "BAG", "--base-frequency", "-1"], "--base-frequency"),
        (["identify", "BAG", "--minimum-speed", "fast"], "--minimum-speed"),
        (["identify", "BAG", "--topic", "/nothing"], "/joint_states"),
        (["identify", "BAG", "-o", "no/such/folder/m.yaml"], "does not exist"),
        (["simulate", "EXC", "--effect", "stribek@joint_1", "-o", "OUT"], "did you mean 'stribeck'"),
        (["simulate", "EXC", "--periods", "0", "-o", "OUT"], "--periods"),
        (["simulate", "EXC", "--servo", "pid", "-o", "OUT"], "pid"),
        (["simulate", "BAG", "-o", "OUT"], "four"),
        (["validate", "EXC", "BAG"], "excitation.yaml"),
        (["montecarlo", "EXC", "--runs", "1"], "--runs"),
        (["design", "--criterion", "e-optimal"], "unknown criterion"),
        (["design", "--harmonics", "0"], "harmonics"),
        (["design", "--harmonics", "900"], "harmonics"),
        (["check", "nothing.yaml"], "no such file"),
        (["design", "--base-frequency", "nan"], "--base-frequency"),
        (["design", "--sample-rate", "1e9"], "--sample-rate"),
        (["design", "--seed", "abc"], "--seed"),
        (["simulate", "EXC", "--periods", "100000000", "-o", "OUT"], "--periods"),
        (["validate", "EXC", "BAG", "--max-rms", "nan"], "--max-rms"),
        (["montecarlo", "EXC", "--seed", "-1"], "--seed"),
    ],
)
def test_one_line_each(
    run: Run, bag: Path, excitation: Path, tmp_path: Path, words: list[str], said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    places = {"BAG": str(bag), "EXC": str(excitation), "OUT": str(tmp_path / "out")}
    refused(run(*[places.get(word, word) for word in words]), said)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda r: {"t": 1e3 * r.t}, "in seconds?"),
        (lambda r: {"t": 1e9 * r.t}, "in seconds?"),
        (lambda r: {"t": r.t + 1e6 * (np.arange(r.samples) > 1000)}, "gap of 1e+06 s"),
    ],
)
def test_impossible_times(run: Run, arm: Any, tmp_path: Path, change: Any, said: str) -> None:
    r = arm.record(1, periods=2)
    refused(run("identify", _write(tmp_path / "r.npz", r, **change(r))), said)


def test_a_copy_of_a_recording_is_no_second_one(run: Run, bag: Path, tmp_path: Path) -> None:
    copy, model = tmp_path / "copy", tmp_path / "model.yaml"
    assert run("identify", bag, "-o", model).code == 0
    shutil.copytree(bag, copy)
    refused(run("identify", bag, copy, "-o", tmp_path / "m.yaml"), "copy holds the samples of", "give every one once")
    refused(run("diagnose", model, bag, copy), "copy holds the samples of")
    refused(run("diagnose", model, bag, "--validation", copy), "copy holds the samples of")
    refused(run("compare", model, bag, copy), "copy holds the samples of")
    added = tmp_path / "added.yaml"
    refused(run("add", model, "stribeck@joint_2", "--bag", bag, copy, "-o", added), "copy holds the samples of")
    refused(run("add", model, "stribeck@joint_2", "--bag", bag, "--validation", copy, "-o", added), "copy holds")
    assert not added.exists()
    assert not (tmp_path / "m.yaml").exists()


def test_force_replaces_recordings_only(run: Run, excitation: Path, tmp_path: Path) -> None:
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine/thesis.tex").write_text("years of work")
    refused(run("simulate", excitation, "--periods", 2, "-o", tmp_path / "mine", "--force"), "no recording")
    assert (tmp_path / "mine/thesis.tex").exists()


def test_a_yaml_bomb_is_refused_at_once(run: Run, tmp_path: Path) -> None:
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x]"]
    lines += [f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 9)}]" for k in range(1, 12)]
    (tmp_path / "bomb.yaml").write_text("\n".join(lines))
    refused(run("check", tmp_path / "bomb.yaml"), "aliases")


def test_excitation_with_unknown_and_missing_keys_is_said_at_once(run: Run, excitation: Path, tmp_path: Path) -> None:
    file = yaml.safe_load(excitation.read_text())
    file["harmoniks"] = file.pop("harmonics")
    path = tmp_path / "e.yaml"
    path.write_text(yaml.safe_dump(file))
    refused(run("check", path), "harmoniks", "'harmonics' is missing")


def test_joints_in_another_order_are_matched_by_name(run: Run, arm: Any, bag: Path, tmp_path: Path) -> None:
    r = arm.record(1, periods=4)
    order = [2, 0, 1]
    shuffled = replace(r, names=tuple(r.names[k] for k in order), q=r.q[:, order], tau=r.tau[:, order])
    write_recording(tmp_path / "shuffled", shuffled)
    a, b = run("identify", bag, "--json").json, run("identify", tmp_path / "shuffled", "--json").json
    assert [p["value"] for p in a["parameters"]] == pytest.approx([p["value"] for p in b["parameters"]], rel=1e-9)


def test_a_full_disk_is_one_line(run: Run, excitation: Path, tmp_path: Path) -> None:
    import subprocess

    mount = tmp_path / "small"
    mount.mkdir()
    made = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=64k", "tmpfs", str(mount)], capture_output=True, check=False
    )
    if made.returncode != 0:
        pytest.skip("a small tmpfs can't be mounted here")
    try:
        done = run("simulate", excitation, "--periods", 2, "-o", mount / "bag")
        refused(done, "No space left")
        assert not (mount / "bag").exists()
    finally:
        subprocess.run(["umount", str(mount)], check=False)


def test_robot_yaml_beside_its_urdf_travels_in_the_model(run: Run, bag: Path, tmp_path: Path) -> None:
    from robot_ident.provenance import config_file

    for name in ("kuka_ir361.yaml", "kuka_ir361.urdf"):
        shutil.copy(config_file("robots", name), tmp_path)
    model = tmp_path / "m.yaml"
    assert run("identify", bag, "--robot", tmp_path / "kuka_ir361.yaml", "-o", model).code == 0
    (tmp_path / "kuka_ir361.urdf").unlink()
    (tmp_path / "kuka_ir361.yaml").unlink()
    assert run("validate", model, bag).code == 0

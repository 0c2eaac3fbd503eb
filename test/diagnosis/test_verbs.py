"""compare, diagnose and add as scripts use them: keys, exit codes, one line on bad input."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from robot_ident.bags import read_recording, write_recording
from robot_ident.model.model_file import write_model

Verb = Callable[..., tuple[int, str, str]]


def test_compare_keeps_the_contract(verb: Verb, files: Any, tmp_path: Path) -> None:
    code, out, err = verb("compare", files.model, *files.bags, "--json", "--fail-on-misfit")
    assert code == 3
    assert "joint_2" in err
    assert len(err.splitlines()) == 1
    data = json.loads(out)
    assert data["schema"] == "robot_ident/comparison/1"
    assert [joint["name"] for joint in data["joints"]] == ["joint_1", "joint_2", "joint_3"]
    two = data["joints"][1]
    assert two["fails"] is True
    assert set(two["lack_of_fit"]) == {"statistic", "p_value"}
    assert {"velocity", "position", "load", "acceleration", "time_since_reversal"} <= set(two["explained_by"])
    assert {"what", "from", "to", "share"} <= set(two["worst"][0])
    assert data["models"][0]["joints"] == data["joints"]


def test_compare_says_where_in_words(verb: Verb, files: Any) -> None:
    code, out, _ = verb("compare", files.bags[0], files.model, *files.bags[1:])
    assert code == 0
    assert "does not fit" in out
    assert "% of the excess" in out
    assert "joint_2, " in out


def test_compare_sets_models_side_by_side(verb: Verb, files: Any, tmp_path: Path) -> None:
    better = tmp_path / "better.yaml"
    code, out, err = verb(
        "add",
        files.model,
        "stribeck@joint_2",
        "--bag",
        *files.bags,
        "--validation",
        files.unseen,
        "-o",
        better,
        "--json",
    )
    assert code == 0, err
    added = json.loads(out)
    assert added["schema"] == "robot_ident/add/1"
    assert added["added"] == ["stribeck@joint_2"]
    for kind in ("residual", "validation"):
        assert added[f"{kind}_mse_after"]["joint_2"] < 0.8 * added[f"{kind}_mse_before"]["joint_2"]
    code, out, err = verb("compare", files.model, better, *files.bags, "--json")
    assert code == 0, err
    data = json.loads(out)
    assert [one["path"] for one in data["models"]] == [str(files.model), str(better)]
    first, second = (one["joints"][1] for one in data["models"])
    assert second["residual_mse"] < 0.8 * first["residual_mse"]
    assert data["joints"][1] == first


def test_compare_writes_what_a_viewer_shows(verb: Verb, files: Any, tmp_path: Path) -> None:
    out = tmp_path / "beside.mcap"
    code, _, err = verb("compare", files.model, files.bags[0], "--mcap", out)
    assert code == 0, err
    original = read_recording(files.bags[0])
    from mcap.reader import make_reader

    with out.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    topics = {channel.topic for channel in summary.channels.values()}
    names = {"/measured", "/predicted", "/residual", "/effect/rigid_body", "/effect/viscous", "/effect/coulomb"}
    assert topics == names
    state = read_recording(out, topic="/measured")
    np.testing.assert_allclose(state.tau, original.tau)
    np.testing.assert_allclose(np.diff(state.t), np.diff(original.t), atol=1e-8)
    assert verb("compare", files.model, files.bags[0], "--mcap", out)[0] == 2


def test_diagnose_keeps_the_contract(verb: Verb, files: Any) -> None:
    code, out, err = verb("diagnose", files.model, *files.bags, "--validation", files.unseen, "--json")
    assert code == 0, err
    data = json.loads(out)
    assert data["schema"] == "robot_ident/diagnosis/1"
    assert data["verdict"] == "missing"
    assert data["missing"] == [{"effect": "stribeck", "joint": "joint_2"}]
    keys = {"effect", "joint", "rank", "p_value", "explained", "parameters", "tied_with", "experiment"}
    keys |= {f"{kind}_mse_{when}" for kind in ("residual", "validation") for when in ("before", "after")}
    assert set(data["candidates"][0]) >= keys
    assert data["candidates"][0]["probability"] >= 0.8
    assert set(data["candidates"][0]["parameters"][0]) >= {"name", "value", "std", "unit"}


def test_every_command_counts_the_same_rows_and_tells_the_same_spread(verb: Verb, files: Any, tmp_path: Path) -> None:
    """The friction makes joint 2 stick: noise hides which way it moves at its reversals."""

    def asked(*words: object) -> Any:
        code, out, err = verb(*words, "--json")
        assert code == 0, err
        return json.loads(out)

    identified = asked("identify", *files.bags, "-o", tmp_path / "again.yaml")["residual"]
    compared = asked("compare", tmp_path / "again.yaml", *files.bags)["joints"]
    assert [one["residual_mse"] for one in compared] == pytest.approx([one["mse"] for one in identified.values()])
    found = asked("diagnose", files.model, *files.bags)["candidates"][0]
    added = asked("add", files.model, "stribeck@joint_2", "--bag", *files.bags, "-o", tmp_path / "b.yaml")["model"]
    of_model = {one["name"]: one for one in added["parameters"]}
    for one in found["parameters"]:
        assert one["value"] == pytest.approx(of_model[one["name"]]["value"], rel=1e-6)
        assert one["std"] == pytest.approx(of_model[one["name"]]["std"] or 0.0, rel=1e-6)


def other_robot(path: Path, recording: Any) -> Path:
    write_recording(path, replace(recording, names=("a1", "a2", "a3")))
    return path


def test_bad_input_is_one_line(verb: Verb, files: Any, bench: Any, tmp_path: Path) -> None:
    recording = bench.record((), 0)
    strange = other_robot(tmp_path / "other.npz", recording)
    alike = tmp_path / "alike.npz"  # joints of other robots have like names
    write_recording(alike, replace(recording, tau=-recording.tau))
    short = tmp_path / "short.npz"
    write_recording(short, recording[slice(0, 1400)])
    motor = tmp_path / "motor.npz"  # a drive that reports on its own side of a gear
    write_recording(motor, replace(recording, tau=recording.tau * np.array([1.0, 0.01, 1.0])))
    still = tmp_path / "still.npz"
    write_recording(still, replace(recording, q=recording.q * np.array([0.0, 1.0, 1.0])))
    rigid = tmp_path / "rigid.npz"
    write_recording(rigid, replace(recording, q=recording.q * 1e-6))
    model, bag = files.model, files.bags[0]
    cases = [
        (["diagnose", model, bag, motor], "motor.npz alone: "),
        (["diagnose", model, motor], "change it to 'joint_2: {effort: {side: motor}}'"),
        (["diagnose", model, still], "joint_1 has no usable sample"),
        (["compare", model, rigid], "joint_1 has no usable sample"),
        (["add", model, "stribek@joint_2", "--bag", bag], "did you mean 'stribeck'"),
        (["add", model, "stribeck@joint_22", "--bag", bag], "did you mean 'joint_2'"),
        (["add", model, "viscous@joint_1", "--bag", bag], "in the model already"),
        (["add", bag, "stribeck@joint_2", "--bag", bag], "not a model"),
        (["diagnose", model, strange], "joint 'joint_1' is missing"),
        (["diagnose", model, bag, "--validation", bag], "is one of the fitted recordings"),
        (["diagnose", model, bag, "--validation", strange], "joint 'joint_1' is missing"),
        (["diagnose", model, bag, "--validation", alike], "a recording of another robot than kuka_ir361?"),
        (["add", model, "stribeck@joint_2", "--bag", bag, "--validation", alike], "a recording of another robot"),
        (["diagnose", model, bag, "-o", tmp_path / "no.yaml"], "only with --add-until-adequate"),
        (["diagnose", bag], "is a model"),
        (["compare", model, strange], "joint 'joint_1' is missing"),
        (["compare", model], "at least one recording"),
        (["compare", bag], "is a model"),
        (["compare", model, short, "--fail-on-misfit", "--json"], "2 periods or more"),
        (["compare", model, tmp_path / "nothing.npz"], "nothing.npz"),
    ]
    before = sorted(tmp_path.iterdir())
    for words, said in cases:
        code, _, err = verb(*words)
        lines = [line for line in err.splitlines() if line.startswith("robot_ident ")]
        assert code == 2, (words, err)
        assert len(lines) == 1, (words, err)
        assert said in lines[0], (words, err)
        assert "Traceback" not in err
    assert sorted(tmp_path.iterdir()) == before


@pytest.mark.long
def test_an_adequate_model_that_misfits_what_is_kept_aside_says_so(
    verb: Verb, files: Any, bench: Any, tmp_path: Path
) -> None:
    """The recordings that are fitted show nothing; the one kept aside does."""
    plain, bags = tmp_path / "plain.yaml", [tmp_path / f"bag_{k}.npz" for k in range(3)]
    for motion, bag in enumerate(bags):
        write_recording(bag, bench.record((), motion))
    write_model(bench.model(bench.measure(())), plain)
    code, out, err = verb("diagnose", plain, *bags, "--validation", files.unseen)
    assert code == 0, err
    assert out.startswith("adequate")
    assert "note: the model does not fit what was kept aside: joint_2 by" in err
    fine = tmp_path / "fine.npz"
    write_recording(fine, bench.record((), 3))
    _, _, err = verb("diagnose", plain, *bags, "--validation", fine)
    assert "kept aside" not in err


def test_a_joint_that_is_held_is_shown_and_not_judged(verb: Verb, files: Any, bench: Any, tmp_path: Path) -> None:
    """Its encoder flickers, its friction holds what it has to; all that moves is judged by periods as ever."""
    plain, held = tmp_path / "plain.yaml", tmp_path / "held.npz"
    write_model(bench.model(bench.measure(())), plain)
    write_recording(held, bench.held("joint_1"))
    code, out, err = verb("compare", plain, held, "--json")
    assert code == 0, err
    joints, (note,) = json.loads(out)["joints"], json.loads(out)["notes"]
    assert [joint["fails"] for joint in joints] == [None, False, False]
    assert joints[0]["noise_variance"] > 0.0
    assert joints[0]["explained_by"] == {}
    assert note.startswith(f"joint_1 stands still in {held}")
    bags = [tmp_path / f"bag_{k}.npz" for k in range(2)]
    for motion, bag in enumerate(bags):
        write_recording(bag, bench.record((), motion))
    code, out, err = verb("diagnose", plain, *bags, "--validation", held)
    assert code == 0, err
    assert out.startswith("adequate")
    code, _, err = verb("diagnose", plain, *bags, held)
    assert code == 0, err


@pytest.mark.long
def test_until_adequate_prints_and_writes_the_staircase(verb: Verb, files: Any, tmp_path: Path) -> None:
    words = ["diagnose", files.model, *files.bags, "--validation", files.unseen, "--add-until-adequate"]
    code, out, err = verb(*words, "--json", "-o", tmp_path / "better.yaml")
    assert code == 0, err
    data = json.loads(out)
    first, *others = data["staircase"]
    assert first["added"] is None
    assert data["after_adding"]["verdict"] == "adequate"
    assert not data["after_adding"]["stopped"]
    assert [step["added"] for step in others] == [f"{m['effect']}@{m['joint']}" for m in data["missing"]]
    for key in ("residual_mse", "validation_mse"):
        assert others[-1][key]["joint_2"] < 0.9 * first[key]["joint_2"]
    # what was predicted before adding is what adding gives
    last = data["candidates"][len(data["missing"]) - 1]
    assert others[-1]["validation_mse"]["joint_2"] == pytest.approx(last["validation_mse_after"]["joint_2"], rel=0.05)
    code, out, _ = verb(*words)
    assert out.startswith("missing: stribeck@joint_2")
    for words_said in ("adding it: rms at joint_2", "validation rms", "noise rms", "rms predicted"):
        assert words_said in out
    assert "diagnosis of the extended model: adequate: what is left over is noise" in out
    assert "\x1b" not in out


@pytest.mark.parametrize("name", ["compare", "trial"])
def test_verbs_are_registered(name: str) -> None:
    from robot_ident.cli.main import VERBS

    assert name in VERBS

"""The documentation and what verbs print agree: every verb, every key."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from robot_ident.cli.main import VERBS
from robot_ident.provenance import config_file
from robot_ident.trajectories.excitation import Excitation

Run = Callable[..., Any]

FREE = (
    "explained_by",
    "depends_on",
    "confusion",
    "margins",
    "held",
    "mimic",
    "processing",
    "provenance",
    "robot_definition",
    "limits",
)
"""Objects whose keys are names of the user's things, or documented where they come from."""

NAMES = re.compile(r"p\d+|.*@.*|/.*")
"""Parameters, effects at a joint and topics: names as well."""

LONG = ("demo", "paper", "replay", "workbench")
"""Verbs that are tested where their processes are."""


@pytest.fixture(scope="module")
def text(checkout: Path) -> str:
    return (checkout / "docs/json.md").read_text(encoding="utf-8")


def documented(text: str, verb: str) -> tuple[str, set[str]]:
    """Return the schema and the keys of a verb's row."""
    row = next((line for line in text.splitlines() if line.startswith(f"| `{verb}` |")), None)
    assert row is not None, f"docs/json.md has no row for {verb}"
    _, _, schema, keys, _ = row.split("|")
    return schema.strip(" `"), set(re.findall(r"`([^`]+)`", keys))


def inner_keys(value: Any, joints: set[str]) -> Iterator[str]:
    """Yield the keys of all objects within, but not names of things."""
    if isinstance(value, dict):
        for key, item in value.items():
            if key not in joints and not NAMES.fullmatch(key):
                yield key
            if key not in FREE:
                yield from inner_keys(item, joints)
    elif isinstance(value, list):
        for item in value:
            yield from inner_keys(item, joints)


@pytest.fixture(scope="module")
def model(arm: Any, tmp_path_factory: pytest.TempPathFactory) -> Path:
    from robot_ident.estimation.identify import identify
    from robot_ident.model.model_file import write_model

    path = tmp_path_factory.mktemp("models") / "model.yaml"
    write_model(identify([arm.record(1, periods=4)], arm.robot), path)
    return path


@pytest.fixture
def other(arm: Any, tmp_path: Path) -> Path:
    """A second recording, with an offset at joint 2 that the model doesn't hold."""
    from dataclasses import replace

    from robot_ident.bags import write_recording

    recording = arm.record(2, periods=4)
    tau = recording.tau + [0.0, 30.0, 0.0]
    write_recording(tmp_path / "other.npz", replace(recording, tau=tau))
    return tmp_path / "other.npz"


def response_of_a_filter(path: Path) -> Path:
    from robot_ident.robot.anti_alias import AntiAlias

    frequency = np.geomspace(1.0, 100.0, 40)
    values = AntiAlias(4, 30.0).response(frequency)
    rows = zip(frequency, np.abs(values), np.rad2deg(np.angle(values)), strict=True)
    path.write_text("frequency,gain,phase\n" + "".join(f"{f},{g},{p}\n" for f, g, p in rows))
    return path


WORDS: dict[str, list[str]] = {
    "init": ["--urdf", "URDF", "-o", "OUT"],
    "design": ["--starts", "1", "--time-limit", "6"],
    "check": ["EXC"],
    "simulate": ["EXC", "--periods", "2", "-o", "OUT"],
    "filter": ["RESPONSE"],
    "recover": ["BAG", "-o", "OUT"],
    "info": ["BAG"],
    "identify": ["BAG"],
    "predict": ["MODEL", "BAG", "-o", "OUT"],
    "validate": ["MODEL", "BAG"],
    "compare": ["MODEL", "OTHER"],
    "diagnose": ["MODEL", "OTHER", "--validation", "BAG"],
    "report": ["MODEL", "--bag", "OTHER", "--validation", "BAG", "--trajectory", "EXC", "-o", "OUT"],
    "add": ["MODEL", "torque_offset@joint_2", "--bag", "OTHER"],
    "effects": [],
    "trial": ["--excitation", "EXC", "EXC2", "--seeds", "0:1", "--kind", "null", "--periods", "4"],
    "trial --family real": ["--seeds", "3018:3019"],
    "trial --family real --kind effects": ["--seeds", "5001:5002"],
    "export": ["MODEL", "--urdf", "OUT", "--validation", "OTHER"],
    "montecarlo": ["EXC", "--runs", "20"],
}


SLOW = ("trial --family real --kind effects",)


@pytest.mark.parametrize(
    "verb", [pytest.param(verb, marks=pytest.mark.long) if verb in SLOW else verb for verb in WORDS]
)
def test_every_key_is_documented(
    run: Run, arm: Any, bag: Path, excitation: Path, model: Path, other: Path, text: str, tmp_path: Path, verb: str
) -> None:
    second = tmp_path / "second.yaml"
    first = Excitation.read(excitation)
    Excitation(first.robot, first.joints, first.series, first.sample_rate).write(second)
    places = {
        "URDF": config_file("robots", "kuka_ir361.urdf"),
        "BAG": bag,
        "EXC": excitation,
        "EXC2": second,
        "MODEL": model,
        "OTHER": other,
        "OUT": tmp_path / "out",
        "RESPONSE": response_of_a_filter(tmp_path / "response.csv"),
    }
    done = run(*verb.split(), *[places.get(word, word) for word in WORDS[verb]], "--json")
    assert done.code == 0, done.err
    schema, keys = documented(text, verb)
    assert done.json["schema"] == schema
    assert set(done.json) == keys
    within = {
        key for name, item in done.json.items() if name not in FREE for key in inner_keys(item, {*arm.robot.joints})
    }
    if verb == "add":
        within -= set(inner_keys(done.json["model"], set()))
    missing = {key for key in within if f"`{key}`" not in text}
    assert not missing, f"docs/json.md does not explain {sorted(missing)} of {verb}"


def test_every_verb_has_its_row(text: str) -> None:
    for verb in VERBS:
        documented(text, verb)
    assert not set(VERBS) - {*WORDS, *LONG}, "run these verbs in WORDS as well"

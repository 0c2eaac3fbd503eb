"""The Foxglove layout draws what `compare --mcap` writes and what the node estimator publishes, nothing else."""

from __future__ import annotations

import ast
import json
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

MESSAGE_PATH = re.compile(r"(?P<topic>/[a-z_/]+)\.effort\[(?P<joint>[0-6])\]")
JOINTS = 7  # drawn at most; an arm with fewer leaves the rest empty


@pytest.fixture(scope="module")
def layout(checkout: Path) -> Any:
    return json.loads((checkout / "config/foxglove_layout.json").read_text(encoding="utf-8"))


def panels(mosaic: Any) -> Iterator[str]:
    """Yield the panels of a mosaic: a name, or two mosaics side by side."""
    if isinstance(mosaic, str):
        yield mosaic
        return
    assert mosaic["direction"] in ("row", "column")
    assert 0 < mosaic["splitPercentage"] < 100
    yield from panels(mosaic["first"])
    yield from panels(mosaic["second"])


def drawn(layout: Any, words: str) -> set[tuple[str, int]]:
    """Return topics and joints that the tabs with these words in their title draw."""
    tabs = [tab for tab in layout["configById"][layout["layout"]]["tabs"] if words in tab["title"]]
    found = set()
    for panel in (name for tab in tabs for name in panels(tab["layout"])):
        for path in layout["configById"][panel]["paths"]:
            match = MESSAGE_PATH.fullmatch(path["value"])
            assert match, path["value"]
            assert path["timestampMethod"] == "headerStamp"
            found.add((match["topic"], int(match["joint"])))
    return found


def published(checkout: Path) -> set[str]:
    """Return the topics of joint states that the estimator publishes and hears, as its source names them."""
    nodes = checkout / "robot_ident/nodes"
    tree = ast.parse(
        "".join((nodes / name).read_text(encoding="utf-8") for name in ("message_buffer.py", "estimator.py"))
    )
    assigned = [n for n in ast.walk(tree) if isinstance(n, ast.AnnAssign)]
    declared = [n.value for n in assigned if ast.unparse(n.target) == "node_name"]
    assert isinstance(declared[0], ast.Constant)
    node, out = declared[0].value, set()
    for call in (n for n in ast.walk(tree) if isinstance(n, ast.Call)):
        made = ast.unparse(call.func).rpartition(".")[2]
        publishes = made == "create_publisher" and ast.unparse(call.args[0]) == "JointState"
        hears = made == "_listen" and isinstance(call.args[0], ast.Constant)
        if publishes or hears:
            topic = ast.literal_eval(call.args[1 if publishes else 0])
            out.add(topic.replace("~", f"/{node}") if topic.startswith("~") else f"/{topic}")
    return out


def test_every_panel_has_its_place(layout: Any) -> None:
    tabs = layout["configById"][layout["layout"]]["tabs"]
    placed = [name for tab in tabs for name in panels(tab["layout"])]
    assert sorted([*placed, layout["layout"]]) == sorted(layout["configById"])


def test_it_draws_what_compare_writes(
    run: Callable[..., Any], layout: Any, arm: Any, bag: Path, tmp_path: Path
) -> None:
    from mcap.reader import make_reader

    assert run("identify", bag, "-o", tmp_path / "model.yaml").code == 0
    assert run("compare", tmp_path / "model.yaml", bag, "--mcap", tmp_path / "beside.mcap").code == 0
    with (tmp_path / "beside.mcap").open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    written = {channel.topic for channel in summary.channels.values()}
    torques, effects = drawn(layout, "compare --mcap, joints"), drawn(layout, "compare --mcap, shares")
    assert {topic for topic, _ in torques | effects} == written
    assert torques == {(topic, k) for topic in ("/measured", "/predicted", "/residual") for k in range(JOINTS)}
    assert {joint for _, joint in effects} == set(range(arm.robot.n))


def test_it_draws_what_the_estimator_publishes(layout: Any, checkout: Path) -> None:
    topics = published(checkout)
    assert topics == {"/joint_states", "/estimator/predicted", "/estimator/residual"}
    assert drawn(layout, "estimator") == {(topic, k) for topic in topics for k in range(JOINTS)}

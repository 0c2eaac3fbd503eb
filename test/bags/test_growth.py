"""A bag that another process is writing: how far one of its topics has come."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from robot_ident.bags import JOINT_STATE, BagGrowth, BagWriter, Series, Topic

STATES, COMMANDS = Topic("/joint_states", JOINT_STATE), Topic("/joint_command", JOINT_STATE)
BEGUN = 1_700_000_000_000_000_000


def send(bag: BagWriter, topic: str, t: list[float]) -> None:
    stamps = BEGUN + np.rint(1e9 * np.array(t)).astype(np.int64)
    for stamp, _, row in Series(topic, ("joint_1",), stamps, np.zeros((len(t), 1))).messages():
        bag.write(topic, row, stamp)
    bag.flush()


def test_it_follows_one_topic_while_the_bag_grows(tmp_path: Path) -> None:
    growth = BagGrowth(tmp_path / "bag", "/joint_command")
    assert growth.seconds() == 0.0, "there is no bag yet"
    with BagWriter(tmp_path / "bag", [STATES]) as bag:
        send(bag, "/joint_states", [0.0, 1.0])
        assert growth.seconds() == 0.0
        bag.add_topic(COMMANDS)
        send(bag, "/joint_command", [2.0])
        send(bag, "/joint_states", [2.5, 3.0])
        assert growth.seconds() == 0.0, "one command says nothing of time"
        send(bag, "/joint_command", [2.5, 4.5])
        assert growth.seconds() == pytest.approx(2.5)
        assert growth.seconds() == pytest.approx(2.5)
        bag.split()
        send(bag, "/joint_command", [7.0])
        assert growth.seconds() == pytest.approx(5.0), "in the next file, too"
        send(bag, "/joint_states", [9.0])
    assert growth.seconds() == pytest.approx(5.0), "a bag that has been closed"
    assert BagGrowth(tmp_path / "bag", "/joint_states").seconds() == pytest.approx(9.0)


def test_a_message_counts_once_it_is_whole(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "whole", [COMMANDS]) as bag:
        for t in (0.0, 1.0, 2.0):
            send(bag, "/joint_command", [t])
        content = (tmp_path / "whole" / "whole_0.mcap").read_bytes()
    (tmp_path / "torn").mkdir()
    file = tmp_path / "torn" / "torn_0.mcap"
    growth, seen = BagGrowth(tmp_path / "torn", "/joint_command"), []
    for size in [*range(0, len(content) - 1, 7), len(content) - 1, len(content)]:
        file.write_bytes(content[:size])
        seen.append(growth.seconds())
    assert seen == sorted(seen) and sorted(set(seen)) == pytest.approx([0.0, 1.0, 2.0])

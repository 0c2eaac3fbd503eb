"""What the recorder keeps when it is killed, when the disk is full and when a bag is split: real processes over DDS.

Run by `make acceptance`; about four minutes. What had been received is known from outside: the publisher numbers what
it sends and notes when, and the recorder's status says how many messages it had written.
"""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from bench import bench, numbers_in, wait
from strict_mcap import judge

pytest.importorskip("rclpy")

KILLS = int(os.environ.get("ROBOT_IDENT_KILLS", "20"))
RATE = 1000.0  # Hz
AT_MOST_LOST = 0.1  # s before a kill
TOPICS = ("joint_states", "joint_command", "left", "right", "tool")


def missing(found: np.ndarray, sent: int) -> int:
    """Return how many of the numbers 1..last found are not there; none may come twice."""
    assert len(np.unique(found)) == len(found)
    assert found.max(initial=0) <= sent
    return int(found.max(initial=0)) - len(found)


def read_by_others(bag: Path, *, ended: bool) -> list[tuple[str, int, bytes]]:
    """Read a bag whole by a strict reader, by `mcap` and by `rosbags`; return topic, time and bytes of its messages."""
    from mcap.reader import make_reader
    from rosbags.rosbag2 import Reader

    ours: list[tuple[str, int, bytes]] = []
    theirs: list[tuple[str, int, bytes]] = []
    for file in sorted(bag.glob("*.mcap"), key=lambda path: int(path.stem.rpartition("_")[2])):
        last = ended or not bag.joinpath(f"{bag.name}_{int(file.stem.rpartition('_')[2]) + 1}.mcap").exists()
        ours += [(one.topic, one.log_time, one.data) for one in judge(file, ended=ended or not last)]
        with file.open("rb") as stream:
            reader = make_reader(stream, validate_crcs=True)
            theirs += [
                (channel.topic, message.log_time, message.data) for _, channel, message in reader.iter_messages()
            ]
    assert sorted(theirs) == sorted(ours)
    with Reader(bag) as reader:
        assert sorted((one.topic, time, bytes(raw)) for one, time, raw in reader.messages()) == sorted(ours)
        assert not ended or reader.message_count == len(ours)
    return ours


def read_whole(bag: Path, folder: Path) -> None:
    """All read the bag of a killed recorder, and what `recover` makes of it, and find the same."""
    from robot_ident.bags import recover

    there = read_by_others(bag, ended=False)
    done = recover(bag, folder / "mended")
    assert done.messages == len(there)
    assert sorted(read_by_others(folder / "mended", ended=True)) == sorted(there)


@pytest.mark.parametrize("compress", [False, True])
@pytest.mark.parametrize("count", [1, 2, 5])
def test_closed_in_order(tmp_path: Path, count: int, compress: bool) -> None:
    with bench(tmp_path, RATE, TOPICS[:count], output=tmp_path / "bag", compress=compress) as (made, recorder):
        made.play()
        time.sleep(3.0)
        made.pause()
        time.sleep(0.5)
        used = recorder.processor()
        assert recorder.end() == 0, recorder.text
        sent = len(made.sent)
    there = read_by_others(tmp_path / "bag", ended=True)
    assert len(there) == count * sent
    size = sum(file.stat().st_size for file in (tmp_path / "bag").glob("*.mcap")) / len(there)
    what = f"closed, {count} topics{', compressed' * compress}"
    print(f"\n{what}: {len(there)} messages of {size:.0f} bytes, {used:.1f} s of CPU")


@pytest.mark.parametrize("count", [1, 2, 5])
def test_killed_at_random_moments(tmp_path: Path, count: int) -> None:
    """No hole, and at most a tenth of a second is lost."""
    random = np.random.default_rng(count)
    worst = 0.0
    for k in range(max(KILLS // 3, 1)):
        folder = tmp_path / str(k)
        folder.mkdir()
        with bench(folder, RATE, TOPICS[:count], output=folder / "bag") as (made, recorder):
            made.play()
            wait(lambda: made.written > 50)  # noqa: B023
            time.sleep(random.uniform(0.0, 3.0))
            at = time.time_ns()
            assert recorder.end(signal.SIGKILL) == -signal.SIGKILL
            sent = list(made.sent)
        found = numbers_in(folder / "bag")
        assert missing(found, len(sent)) == 0, "messages are missing before the last one"
        behind = (at - sent[found.max()]) / 1e9  # of the first that isn't there
        worst = max(worst, behind)
        assert behind < AT_MOST_LOST, f"what was sent in the last {behind:.3f} s before the kill is lost"
        read_whole(folder / "bag", folder)
    print(f"\nkilled, {count} topics: no hole; lost is at most what was sent in the last {1e3 * worst:.1f} ms")


def test_full_disk(tmp_path: Path) -> None:
    """A disk of two megabytes: one clear line, and nothing that is older than a second is lost."""
    disk = tmp_path / "disk"
    disk.mkdir()
    mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=2m", "tmpfs", disk], capture_output=True)
    if mounted.returncode:
        pytest.skip(f"no file system can be mounted here ({mounted.stderr.decode().strip()})")
    try:
        with bench(tmp_path, RATE, output=disk / "bag") as (publisher, recorder):
            publisher.play()
            code = recorder.popen.wait(120.0)
            at, sent = time.time_ns(), list(publisher.sent)
        shutil.copytree(disk / "bag", tmp_path / "bag")
    finally:
        subprocess.run(["umount", disk], check=True)
    said = [line for line in recorder.text.splitlines() if "FATAL" in line or "Traceback" in line]
    assert code == 2 and len(said) == 1 and "No space left on device" in said[0], recorder.text
    found = numbers_in(tmp_path / "bag")
    ended = (at - sent[found.max() - 1]) / 1e9
    assert missing(found, len(sent)) == 0
    promised = re.search(r"at least (\d+) of its messages are kept", said[0])
    assert promised and int(promised[1]) <= len(found)
    print(f"\nfull disk: {said[0].split(': ', 1)[-1]}")
    print(f"  {len(found)} messages without a hole; the last was sent {ended:.2f} s before the recorder had ended")
    assert ended < 1.5, "the process ends at once, so that no more is lost"
    read_whole(tmp_path / "bag", tmp_path)


def test_a_disk_without_room_for_the_end(tmp_path: Path) -> None:
    """The index and the summary don't fit any more: one line, exit code 2, every message kept."""
    with bench(tmp_path, RATE, output=tmp_path / "bag") as (publisher, recorder):
        publisher.play()
        wait(lambda: publisher.written > 500)
        publisher.pause()
        time.sleep(1.0)
        size = sum(file.stat().st_size for file in (tmp_path / "bag").glob("*.mcap"))
        subprocess.run(["prlimit", f"--pid={recorder.popen.pid}", f"--fsize={size + 10}"], check=True)
        assert recorder.end() == 2
        sent = len(publisher.sent)
    assert "can't be written" in recorder.text and "Traceback" not in recorder.text, recorder.text
    assert len(numbers_in(tmp_path / "bag")) == sent
    read_whole(tmp_path / "bag", tmp_path)


@pytest.mark.parametrize(("parameter", "value"), [("split_duration", 1.0), ("split_size", 1)])
def test_split_and_further_topics(tmp_path: Path, parameter: str, value: float) -> None:
    """Files of a second or a megabyte; whole bags that others read, with every topic in every file."""
    from rosbags.highlevel import AnyReader
    from std_msgs.msg import String

    with bench(tmp_path, 1000.0, output=tmp_path / "bag", topics="[/note]", **{parameter: value}) as (made, recorder):
        note = made.node.create_publisher(String, "/note", 10)
        wait(note.get_subscription_count)
        made.play()
        wait(lambda: made.written > 7000)
        note.publish(String(data="seven thousand"))
        wait(lambda: len(list((tmp_path / "bag").glob("*.mcap"))) > 2)
        time.sleep(0.5)
        assert recorder.end() == 0, recorder.text
        sent = len(made.sent)
    found = numbers_in(tmp_path / "bag")
    assert missing(found, sent) == 0 and len(found) > 7000
    with AnyReader([tmp_path / "bag"]) as reader:
        notes = [c for c in reader.connections if c.topic == "/note"]
        assert [reader.deserialize(raw, c.msgtype).data for c, _, raw in reader.messages(notes)] == ["seven thousand"]
        assert reader.message_count == len(found) + 1
    for file in (tmp_path / "bag").glob("*.mcap"):
        with file.open("rb") as stream:
            from mcap.reader import make_reader

            summary = make_reader(stream).get_summary()
            assert summary is not None and {c.topic for c in summary.channels.values()} >= {"/joint_states", "/note"}
    print(f"\n{parameter} = {value:g}: {len(list((tmp_path / 'bag').glob('*.mcap')))} files, {len(found)} messages")


def test_losses_are_counted_into_the_metadata(tmp_path: Path) -> None:
    """Left out, sent twice and sent late on purpose: the bag's metadata says how many of each."""
    import yaml

    with bench(tmp_path, 200.0, output=tmp_path / "bag") as (made, recorder):
        for k in [*range(100), 99, *range(105, 200), 150, *range(200, 300)]:
            made.publish(k, [0.0] * 6, 1_700_000_000_000_000_000 + 5_000_000 * k)
            time.sleep(0.002)
        wait(lambda: made.written == 297)
        assert recorder.end() == 0, recorder.text
    content = yaml.safe_load((tmp_path / "bag" / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    said = content["custom_data"]["robot_ident/joint_states"]
    assert said == (
        "297 messages at 200.0 Hz, 0 lost on the way, 1 gaps (5 samples missing), 1 repeated stamps, 1 late"
    ), said


if __name__ == "__main__":
    sys.exit(pytest.main([__file__, "-s"]))

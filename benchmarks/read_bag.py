"""How long a bag takes to become arrays, beside the time in which the `mcap` library hands out the raw bytes.

    python benchmarks/read_bag.py [--messages 1000000] [--joints 7] [--keep FOLDER]

Both read the same files in the same run, each from a warm page cache: a bag as the recorder writes it (a chunk each
50 ms) and one as `simulate` writes it (chunks of 1 MB, zstd). The last column is the library's time over ours.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from robot_ident.bags import JOINT_STATE, BagWriter, Series, Topic, read_recording
from robot_ident.signals.motion import Array


def write_bag(path: Path, messages: int, joints: int, *, compress: bool, every: int) -> None:
    """Write `messages` JointStates at 1 kHz with random values, a chunk after `every` of them."""
    random = np.random.default_rng(0)
    names = tuple(f"joint_{k + 1}" for k in range(joints))
    with BagWriter(path, [Topic("/joint_states", JOINT_STATE)], compress=compress) as bag:
        for first in range(0, messages, every):
            count = min(every, messages - first)
            stamps = 1_700_000_000_000_000_000 + 1_000_000 * np.arange(first, first + count)
            values: list[Array] = [random.normal(size=(count, joints)) for _ in range(3)]
            for stamp, topic, row in Series("/joint_states", names, stamps, *values).messages():
                bag.write(topic, row, stamp)
            bag.flush()


def raw_bytes(path: Path) -> int:
    """Take every message's bytes from the library; return how many messages there were."""
    from mcap.reader import make_reader

    count = 0
    with next(path.glob("*.mcap")).open("rb") as file:
        for _, _, message in make_reader(file).iter_messages(log_time_order=False):
            count += len(message.data) > 0
    return count


def arrays(path: Path) -> int:
    """Read the bag into arrays; return the number of samples."""
    return read_recording(path).samples


def seconds(task: Callable[[Path], int], path: Path, expected: int) -> float:
    """Return the time of one call, which must deliver all messages."""
    start = time.perf_counter()
    got = task(path)
    taken = time.perf_counter() - start
    if got != expected:
        raise SystemExit(f"{task.__name__} delivered {got} of {expected} messages")
    return taken


def main() -> None:
    """Write, read twice, print the ratio."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--messages", type=int, default=1_000_000)
    parser.add_argument("--joints", type=int, default=7)
    parser.add_argument("--keep", type=Path, help="an existing folder in which the bags are left")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        room = options.keep or Path(temporary)
        print(f"{options.messages} messages of {options.joints} joints")
        print(f"{'bag':<10} {'mcap raw bytes':>15} {'our arrays':>12} {'ratio':>7}")
        for name, compress, every in (("recorded", False, 50), ("simulated", True, 50_000)):
            bag = room / f"benchmark_{name}"
            write_bag(bag, options.messages, options.joints, compress=compress, every=every)
            seconds(arrays, bag, options.messages)  # warms the page cache for both
            theirs = seconds(raw_bytes, bag, options.messages)
            ours = seconds(arrays, bag, options.messages)
            print(f"{name:<10} {theirs:>13.2f} s {ours:>10.2f} s {theirs / ours:>7.1f}")


if __name__ == "__main__":
    main()

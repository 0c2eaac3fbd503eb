"""Writes a whole recording at once: a rosbag2 folder, a single `.mcap`, or a table; and predicted torque beside it."""

from __future__ import annotations

import heapq
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from operator import itemgetter
from pathlib import Path

import numpy as np

from robot_ident.bags import cdr
from robot_ident.bags.bag_writer import BagWriter
from robot_ident.bags.read import TABLES
from robot_ident.bags.rosbag2_metadata import Qos, qos_text
from robot_ident.bags.storage import JOINT_STATE, Integers, Topic
from robot_ident.bags.tables import write_table
from robot_ident.errors import InputError
from robot_ident.estimation.prediction import Prediction
from robot_ident.files import whole
from robot_ident.recording.recording import Recording
from robot_ident.signals.motion import Array

_AT_ONCE = 65_536  # messages
_LAST = 2**31 * 1_000_000_000  # ns; seconds are a signed number of 32 bits in builtin_interfaces/Time


@dataclass(frozen=True)
class Series:
    """N JointStates on one topic: stamps [N] ns (also receive and send time), position, velocity, effort [N, n]."""

    topic: str
    names: tuple[str, ...]
    stamps: Integers
    position: Array | None = None
    velocity: Array | None = None
    effort: Array | None = None

    def messages(self) -> Iterator[tuple[int, str, bytes]]:
        """Yield stamp, topic and bytes (CDR) of the messages in the order of their stamps."""
        order = np.argsort(self.stamps, kind="stable")
        for rows in np.split(order, range(_AT_ONCE, len(order), _AT_ONCE)):
            q, dq, tau = (None if part is None else part[rows] for part in (self.position, self.velocity, self.effort))
            messages = cdr.serialise(self.names, self.stamps[rows], q, dq, tau)
            for stamp, row in zip(self.stamps[rows].tolist(), messages, strict=True):
                yield stamp, self.topic, row.tobytes()


def write_recording(
    path: Path | str,
    recording: Recording,
    *,
    start_ns: int | None = None,
    topic: str = "/joint_states",
    force: bool = False,
) -> None:
    """Write a recording, whole or not at all, in the form that the suffix of `path` names (none: a rosbag2 folder).

    start_ns: the stamp of t = 0; None takes the recording's own, or else the present time, since a stamp of zero means
    that there is none. topic: of the JointState messages. InputError when the path exists (and not `force`) or the disk
    refuses.
    """
    path = Path(path)
    with whole(path, force=force) as draft:
        if path.suffix in TABLES:
            arrays = {"t": recording.t, "q": recording.q, "tau": recording.tau, "names": np.array(recording.names)}
            write_table(draft, path.suffix, arrays if recording.dq is None else {**arrays, "dq": recording.dq})
            return
        start = start_ns or max(recording.start_ns, 0) or time.time_ns()
        stamps = start + np.rint(recording.t * 1e9).astype(np.int64)
        if len(stamps) and not 0 <= stamps[0] <= stamps[-1] < _LAST:
            raise InputError(
                f"{path}: it would last from {stamps[0] / 1e9:.0f} to {stamps[-1] / 1e9:.0f} s since 1970;"
                " the stamps of ROS 2 end in 2038"
            )
        states = Series(topic, recording.names, stamps, recording.q, recording.dq, recording.tau)
        _write_bag(draft, path, [states])


def write_series(path: Path | str, series: Sequence[Series], *, force: bool = False) -> None:
    """Write topics of JointStates, whole or not at all: one `.mcap` file, or else a rosbag2 folder.

    The messages of all topics come in the order of their stamps. InputError when the path exists (and not `force`) or
    the disk refuses.
    """
    path = Path(path)
    with whole(path, force=force) as draft:
        _write_bag(draft, path, series)


def _write_bag(draft: Path, path: Path, series: Sequence[Series]) -> None:
    folder = draft.with_name(path.stem) if path.suffix == ".mcap" else draft
    topics = [Topic(one.topic, JOINT_STATE, qos=qos_text([Qos()])) for one in series]
    with BagWriter(folder, topics, shown_as=path) as bag:
        for stamp, topic, message in heapq.merge(*(one.messages() for one in series), key=itemgetter(0)):
            bag.write(topic, message, stamp)
    if path.suffix == ".mcap":
        (folder / f"{folder.name}_0.mcap").rename(draft)


def write_prediction(path: Path | str, prediction: Prediction, *, force: bool = False) -> None:
    """Write a prediction, whole or not at all, in the form that the suffix of `path` names (none: a rosbag2 folder).

    .npz: t, q, dq, ddq, tau, tau_std, tau_band [N, n] and names; .csv: the same by column. Bags: the topics /predicted,
    /predicted_lower and /predicted_upper, the band's ends. InputError when the path exists (and not `force`).
    """
    path = Path(path)
    if path.suffix not in TABLES:
        stamps = (prediction.start_ns or time.time_ns()) + np.rint(prediction.t * 1e9).astype(np.int64)
        q, dq = prediction.motion.q, prediction.motion.dq
        efforts = {
            "/predicted": prediction.torque,
            "/predicted_lower": prediction.torque - prediction.band,
            "/predicted_upper": prediction.torque + prediction.band,
        }
        series = [Series(topic, prediction.joints, stamps, q, dq, effort) for topic, effort in efforts.items()]
        write_series(path, series, force=force)
        return
    arrays = {"t": prediction.t, "names": np.array(prediction.joints)}
    arrays |= {key: getattr(prediction.motion, key) for key in ("q", "dq", "ddq")}
    arrays |= {"tau": prediction.torque, "tau_std": prediction.std, "tau_band": prediction.band}
    with whole(path, force=force) as draft:
        write_table(draft, path.suffix, arrays, digits=12)

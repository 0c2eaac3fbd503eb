"""Writes a whole recording at once: a rosbag2 folder, a single `.mcap`, or a table."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np

from robot_ident.bags.forms import TABLES
from robot_ident.bags.qos import Qos, qos_text
from robot_ident.bags.storage import JOINT_STATE, Topic
from robot_ident.bags.writer import BagWriter
from robot_ident.errors import InputError
from robot_ident.files import whole
from robot_ident.recording.recording import Recording

_LAST = 2**31 * 1_000_000_000  # ns; seconds are a signed number of 32 bits in builtin_interfaces/Time


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
            TABLES[path.suffix].write(draft, recording)
            return
        start = start_ns or max(recording.start_ns, 0) or time.time_ns()
        stamps = start + np.rint(recording.t * 1e9).astype(np.int64)
        if len(stamps) and not 0 <= stamps[0] <= stamps[-1] < _LAST:
            raise InputError(
                f"{path}: it would last from {stamps[0] / 1e9:.0f} to {stamps[-1] / 1e9:.0f} s since 1970;"
                " the stamps of ROS 2 end in 2038"
            )
        folder = draft.with_name(path.stem) if path.suffix == ".mcap" else draft
        with BagWriter(folder, [Topic(topic, JOINT_STATE, qos=qos_text([Qos()]))], chunked=True, shown_as=path) as bag:
            bag.write_joint_states(topic, recording.names, stamps, recording.q, recording.dq, recording.tau)
        if path.suffix == ".mcap":
            (folder / f"{folder.name}_0.mcap").rename(draft)

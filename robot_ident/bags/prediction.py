"""Writes a predicted torque: a table with its band, or JointState topics that viewers overlay."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np

from robot_ident.bags.qos import Qos, qos_text
from robot_ident.bags.storage import JOINT_STATE, Topic
from robot_ident.bags.writer import BagWriter
from robot_ident.estimation.predict import Prediction
from robot_ident.files import whole


def write_prediction(path: Path | str, prediction: Prediction, *, force: bool = False) -> None:
    """Write a prediction, whole or not at all, in the form that the suffix of `path` names (none: a rosbag2 folder).

    .npz: t, q, dq, ddq, tau, tau_std, tau_band [N, n] and names; .csv: the same by column. Bags: the topics /predicted,
    /predicted_lower and /predicted_upper, the band's ends. InputError when the path exists (and not `force`).
    """
    path = Path(path)
    motion = prediction.motion
    arrays = {"q": motion.q, "dq": motion.dq, "ddq": motion.ddq}
    arrays |= {"tau": prediction.torque, "tau_std": prediction.std, "tau_band": prediction.band}
    with whole(path, force=force) as draft:
        if path.suffix == ".npz":
            with draft.open("wb") as file:
                np.savez(file, t=prediction.t, names=np.array(prediction.joints), **arrays)  # type: ignore[arg-type]
        elif path.suffix == ".csv":
            header = ["t", *(f"{key}_{joint}" for key in arrays for joint in prediction.joints)]
            columns = np.column_stack([prediction.t, *arrays.values()])
            np.savetxt(draft, columns, fmt="%.12g", delimiter=",", header=",".join(header), comments="")
        else:
            _write_bag(path, draft, prediction)


def _write_bag(path: Path, draft: Path, prediction: Prediction) -> None:
    topics = {
        "/predicted": prediction.torque,
        "/predicted_lower": prediction.torque - prediction.band,
        "/predicted_upper": prediction.torque + prediction.band,
    }
    start = prediction.start_ns or time.time_ns()
    stamps = start + np.rint(prediction.t * 1e9).astype(np.int64)
    folder = draft.with_name(path.stem) if path.suffix == ".mcap" else draft
    qos = qos_text([Qos()])
    with BagWriter(folder, [Topic(name, JOINT_STATE, qos=qos) for name in topics], chunked=True, shown_as=path) as bag:
        for name, torque in topics.items():
            motion = prediction.motion
            bag.write_joint_states(name, prediction.joints, stamps, motion.q, motion.dq, torque)
    if path.suffix == ".mcap":
        (folder / f"{folder.name}_0.mcap").rename(draft)

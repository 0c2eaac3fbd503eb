"""Writes a predicted torque: a table with its band, or JointState topics that viewers overlay."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np

from robot_ident.bags.write import Series, write_series
from robot_ident.estimation.prediction import Prediction
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
    if path.suffix not in (".npz", ".csv"):
        write_series(path, _series(prediction), force=force)
        return
    with whole(path, force=force) as draft:
        if path.suffix == ".npz":
            with draft.open("wb") as file:
                np.savez(file, t=prediction.t, names=np.array(prediction.joints), **arrays)  # type: ignore[arg-type]
        else:
            header = ["t", *(f"{key}_{joint}" for key in arrays for joint in prediction.joints)]
            columns = np.column_stack([prediction.t, *arrays.values()])
            np.savetxt(draft, columns, fmt="%.12g", delimiter=",", header=",".join(header), comments="")


def _series(prediction: Prediction) -> list[Series]:
    start = prediction.start_ns or time.time_ns()
    stamps = start + np.rint(prediction.t * 1e9).astype(np.int64)
    efforts = {
        "/predicted": prediction.torque,
        "/predicted_lower": prediction.torque - prediction.band,
        "/predicted_upper": prediction.torque + prediction.band,
    }
    q, dq = prediction.motion.q, prediction.motion.dq
    return [Series(topic, prediction.joints, stamps, q, dq, effort) for topic, effort in efforts.items()]

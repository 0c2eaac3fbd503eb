"""What the pictures show, in words, for readers who don't see them."""

from __future__ import annotations

import numpy as np

from robot_ident.report.wording import joined, short
from robot_ident.workbench.view import View


def over_time_told(view: View, joint: int, recording: int) -> str:
    """Return the size of torque and residual of a joint along a recording, and when the residual is largest."""
    rows, unit = view.rows[recording], view.unit(joint)
    counts = np.flatnonzero(rows.weight[:, joint] > 0)
    words = f"{view.joints[joint]} in {view.recordings[recording]['name']}: "
    words += f"torque up to {short(float(np.abs(rows.measured[:, joint]).max()))} {unit}"
    if not len(counts):
        return f"{words}; no sample counts."
    residual = view.residual[recording][counts, joint]
    peak = int(np.argmax(np.abs(residual)))
    size, when = short(float(np.sqrt(np.mean(residual**2)))), short(float(rows.t[counts[peak]]))
    return f"{words}, residual {size} {unit} rms, at most {short(abs(float(residual[peak])))} at {when} s."


def scatter_told(view: View, joint: int) -> str:
    """Return where the residual's excess is packed."""
    words = view.comparison["joints"][joint]["worst_in_words"]
    return f"Where the residual of {view.joints[joint]} is large: {'; '.join(words) or 'nowhere in particular'}."


def spectrum_told(view: View, joint: int, recording: int) -> str:
    """Return the largest line of a joint's residual, and its noise."""
    found, y = view.lines[recording], view.residual_lines[recording][:, joint]
    k, unit = int(np.argmax(y)), view.unit(joint)
    noise = float(found.noise[k, joint])
    floor = f", where noise leaves {short(noise)}" if np.isfinite(noise) else ""
    return f"The largest line lies at {short(float(found.frequency[k]))} Hz: {short(float(y[k]))} {unit} rms{floor}."


def staircase_told(view: View, joint: int) -> str:
    """Return the errors of a joint from step to step."""
    name = view.joints[joint]
    errors = [View(view.session, number).errors for number in view.session.path(view.number)]
    parts = [
        f"{kind} {' to '.join(short(float(one[kind][name]) ** 0.5) for one in errors)} {view.unit(joint)} rms"
        for kind in ("training", "validation")
        if errors[-1][kind] is not None
    ]
    return f"{name} from step to step: {joined(parts)}."

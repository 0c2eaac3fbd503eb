"""Columns of effects that users wrote: whatever goes wrong in them is one line that names the file and the class."""

from __future__ import annotations

import sys
import traceback
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from robot_ident.errors import InputError
from robot_ident.signals.motion import Array, Motion

if TYPE_CHECKING:
    from robot_ident.effects.effect import Effect, Torques


def is_own(kind: type[Effect]) -> bool:
    """Return whether an effect is none of the catalogue's."""
    return not kind.__module__.startswith("robot_ident.")


def origin(kind: type[Effect]) -> str:
    """Return the file that a class was written in, empty where there is none."""
    return getattr(sys.modules.get(kind.__module__), "__file__", None) or ""


def line_in(file: str, error: BaseException) -> str:
    """Return `, line N` of the place in a user's file where an error came up, empty where it is elsewhere."""
    frames = traceback.extract_tb(error.__traceback__)
    lines = [frame.lineno for frame in frames if Path(frame.filename).resolve() == Path(file).resolve()]
    return f", line {lines[-1]}" if lines else ""


@contextmanager
def faults_of(kind: type[Effect]) -> Iterator[None]:
    """Make one line of whatever goes wrong in a user's class; what it prints goes to standard error."""
    if not is_own(kind):
        yield
        return
    file = origin(kind) or kind.__module__
    try:
        with redirect_stdout(sys.stderr):
            yield
    except InputError:
        raise
    except (Exception, SystemExit) as error:  # whatever a user's class does wrong is an error of that file
        raise InputError(
            f"{file}{line_in(file, error)}: class {kind.__name__}: {type(error).__name__}: {error}"
        ) from error


def own_columns(effect: Effect, motion: Motion, torques: Torques | None) -> Array:
    """Return the columns [N, n, K] of a user's effect; InputError where it fails or gives anything else."""
    kind, shape = type(effect), (motion.samples, effect.robot.n, len(type(effect).coefficients))
    file = origin(kind) or kind.__module__
    with faults_of(kind), warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("error", np.exceptions.ComplexWarning)
        made = np.asarray(effect.full_columns(motion, torques), dtype=float)
    inner = ", ".join(f"{name} = {value:.6g}" for name, value in effect.setting.items())
    where = f" at {inner}" if inner else ""
    if made.shape != shape:
        raise InputError(
            f"{file}: class {kind.__name__}: columns of shape {made.shape}{where}, not {shape}: samples, joints, and"
            " one of each coefficient"
        )
    if torques is not None and torques.rigid is None:  # none is known yet, and 0 / 0 may stand where it will be
        return np.nan_to_num(made, nan=0.0, posinf=0.0, neginf=0.0)
    if not np.isfinite(made).all():
        raise InputError(f"{file}: class {kind.__name__}: a column that is not finite{where}")
    return made

"""Recordings as plain tables: `.csv` with a header and `.npz`, for users whose data never saw ROS."""

from __future__ import annotations

import csv
import tokenize
import warnings
import zipfile
import zlib
from collections import Counter
from collections.abc import Mapping, Sequence
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from robot_ident.bags.joint_states import Samples, in_order
from robot_ident.bags.storage import most, one_line
from robot_ident.errors import InputError, did_you_mean
from robot_ident.recording.recording import LONGEST, Recording
from robot_ident.signals.motion import Array

_DELIMITERS = ",;\t"
# what numpy and zipfile raise on archives that are damaged on purpose or by accident
_OF_NUMPY = (ValueError, TypeError, LookupError, ArithmeticError, EOFError, MemoryError, RuntimeError, SyntaxError)
_UNREADABLE = (*_OF_NUMPY, tokenize.TokenError, zipfile.BadZipFile, zlib.error)


def read_csv(path: Path, joints: Sequence[str] | None = None) -> Recording:
    """Read a table with the columns `t` [s], `q_NAME`, `tau_NAME` and perhaps `dq_NAME` for each joint.

    InputError names a missing column, or the row and column of a cell that is no number.
    """
    header, delimiter, line = _header(path)
    names, notes = _joints_of(path, header, joints)
    place = {name: number for number, name in enumerate(header)}
    velocities = [name for name in names if f"dq_{name}" in place]
    if velocities and len(velocities) < len(names):
        notes.append("dq is given for some joints only and is not used")
        velocities = []
    wanted = ["t", *(f"q_{n}" for n in names), *(f"tau_{n}" for n in names), *(f"dq_{n}" for n in velocities)]
    torn = _torn_rows(path, line)
    if torn is not None:
        notes.append("the last row has no line end and is left out: the file may break off in it")
    values = _cells(path, [place[name] for name in wanted], wanted, delimiter, line, torn)
    n = len(names)
    dq = values[:, 2 * n + 1 :] if velocities else None
    return _recording(path, names, Samples(values[:, 0], values[:, 1 : n + 1], values[:, n + 1 : 2 * n + 1], dq), notes)


def _header(path: Path) -> tuple[list[str], str, int]:
    """Return the column names, the delimiter and the number of lines up to and including the header."""
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            for number, text in enumerate(file, start=1):
                if text.strip() and not text.startswith("#"):
                    delimiter = max(_DELIMITERS, key=text.count)
                    return [name.strip() for name in next(csv.reader([text], delimiter=delimiter))], delimiter, number
    except OSError as error:
        raise InputError(f"{path}: can't be read ({error.strerror})") from error
    except (UnicodeDecodeError, csv.Error, StopIteration) as error:
        raise InputError(f"{path}: is no CSV text ({error})") from error
    raise InputError(f"{path}: the file is empty")


def _joints_of(path: Path, header: list[str], joints: Sequence[str] | None) -> tuple[tuple[str, ...], list[str]]:
    there = [name.removeprefix("q_") for name in header if name.startswith("q_")]
    for name, count in Counter(header).items():
        if count > 1:
            raise InputError(f"{path}: column {one_line(name)!r} stands in the header {count} times")
    if "t" not in header or not there:
        missing = "t" if "t" not in header else "q_NAME"
        raise InputError(
            f"{path}: column {missing!r} is missing; expected t, q_NAME..., tau_NAME... and perhaps dq_NAME..., "
            f"found {one_line(*header)}"
        )
    names = tuple(there if joints is None else joints)
    known = set(header)
    for column in (f"{kind}_{name}" for name in names for kind in ("q", "tau")):
        if column not in known:
            raise InputError(f"{path}: column {one_line(column)!r} is missing{did_you_mean(column, header)}")
    used = {"t", *(f"{kind}_{name}" for kind in ("q", "dq", "tau") for name in there)}
    others = [name for name in header if name not in used]
    return names, [f"columns not used: {one_line(*others)}"] if others else []


def _torn_rows(path: Path, skip: int) -> int | None:
    """Return how many rows follow the header before one without a line end, None where the last row has its own."""
    with path.open("rb") as file:
        file.seek(-1, 2)
        if file.read(1) in b"\r\n":
            return None
        file.seek(0)
        rows = sum(bool(text.partition(b"#")[0].strip()) for text in islice(file, skip, None))
    return rows - 1 if rows > 1 else None


def _cells(path: Path, columns: list[int], names: list[str], delimiter: str, skip: int, rows: int | None) -> Array:
    """Return the columns [N, k] of at most `rows` lines after the first `skip`; InputError names a cell."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # of a table without rows, which is told below
            values: Array = np.loadtxt(
                path,
                delimiter=delimiter,
                skiprows=skip,
                usecols=columns,
                ndmin=2,
                dtype=float,
                encoding="utf-8",
                max_rows=rows,
            )
    except (ValueError, OSError) as error:
        _complain(path, columns, names, delimiter, skip)
        raise InputError(f"{path}: can't be read as a table ({error})") from error
    if not values.size:
        raise InputError(f"{path}: has a header but no rows")
    if not np.isfinite(values).all():
        _complain(path, columns, names, delimiter, skip)
    return values


def _complain(path: Path, columns: list[int], names: list[str], delimiter: str, skip: int) -> None:
    """Find the first cell that is no finite number and say where it stands."""
    with path.open(encoding="utf-8-sig", errors="replace", newline="") as file:
        for number, text in enumerate(file, start=1):
            content = text.split("#")[0].strip("\r\n")
            if number <= skip or not content.strip():
                continue
            cells = content.split(delimiter)
            for column, name in zip(columns, names, strict=True):
                if column >= len(cells):
                    raise InputError(f"{path}: row {number} has {len(cells)} cells; column {name!r} is missing")
                try:
                    finite = np.isfinite(float(cells[column]))
                except ValueError:
                    finite = False
                if not finite:
                    cell = one_line(cells[column])[:60]
                    raise InputError(f"{path}: row {number}, column {name!r}: {cell!r} is not a number")


def refuse_unnamed(path: Path, joints: int) -> None:
    """Raise InputError where a `.npz` without names has other columns than a robot has joints: which are they?"""
    if path.suffix != ".npz":
        return
    arrays = _load(path)
    if "names" in arrays or "q" not in arrays:
        return
    columns = arrays["q"].shape[-1] if np.ndim(arrays["q"]) == 2 else 1
    if columns != joints:
        raise InputError(
            f"{path}: q has {columns} columns and no names, the robot {joints} joints; add `names` [{columns}] to the"
            " file, so that it is known which column is which joint"
        )


def read_npz(path: Path, joints: Sequence[str] | None = None) -> Recording:
    """Read `t` [N] s, `q` and `tau` [N, n], optional `dq` [N, n] and `names` [n] (`joint_1`... where missing).

    One joint may come as [N]. Nothing pickled is ever loaded. InputError names the array that is missing or wrong.
    """
    arrays = _load(path)
    for key in ("t", "q", "tau"):
        if key not in arrays:
            raise InputError(f"{path}: array {key!r} is missing; it has {one_line(*sorted(arrays)) or 'none'}")
    t = _numbers(path, arrays, "t")
    if t.ndim != 1 or not len(t):
        raise InputError(f"{path}: t must have the shape [N] with N > 0, it has {list(t.shape)}")
    columns = {key: _numbers(path, arrays, key) for key in ("q", "tau", "dq") if key in arrays}
    columns = {key: value[:, None] if value.ndim == 1 else value for key, value in columns.items()}
    n = columns["q"].shape[-1] if columns["q"].ndim else 0
    for key, value in columns.items():
        if value.shape != (len(t), n) or not n:
            expected = f"[{len(t)}, {n or 'n'}]"
            raise InputError(f"{path}: {key} must have the shape {expected} as t and q say, it has {list(value.shape)}")
    names = tuple(f"joint_{k + 1}" for k in range(n))
    if "names" in arrays:
        names = tuple(str(name) for name in np.atleast_1d(arrays["names"]).astype(str).reshape(-1))
        if len(set(names)) != n or len(names) != n:
            raise InputError(f"{path}: names must be {n} different words, they are {one_line(*names)}")
    recording = _recording(path, names, Samples(t, columns["q"], columns["tau"], columns.get("dq")), [])
    return recording if joints is None else recording.with_joints(tuple(joints))


def _load(path: Path) -> Mapping[str, Any]:
    key = "the archive"
    if path.is_file() and not zipfile.is_zipfile(path):
        raise InputError(f"{path}: is no .npz archive")
    try:
        with zipfile.ZipFile(path) as packed:
            claimed = sum(entry.file_size for entry in packed.infolist())
        if claimed > most(path.stat().st_size):
            raise InputError(f"{path}: unfolds to {claimed} bytes, more than any recording of its size")
        with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
            arrays = {}
            for key in archive.files:
                if key in ("t", "q", "tau", "dq", "names"):
                    arrays[key] = archive[key]
            return arrays or dict.fromkeys(archive.files)
    except OSError as error:
        raise InputError(f"{path}: can't be read ({error.strerror or error})") from error
    except _UNREADABLE as error:
        first_line = (str(error).splitlines() or ["it is damaged"])[0]
        reason = "it is pickled; save plain arrays of numbers" if "allow_pickle" in first_line else first_line
        raise InputError(f"{path}: {key} can't be loaded ({reason})") from error


def _numbers(path: Path, arrays: Mapping[str, Any], key: str) -> Array:
    array = np.asarray(arrays[key])
    if array.dtype.kind not in "fiub":
        raise InputError(f"{path}: {key} must hold real numbers, it holds {array.dtype}")
    return array.astype(float)


def _recording(path: Path, names: tuple[str, ...], samples: Samples, notes: list[str]) -> Recording:
    finite = np.isfinite(samples.stamp)
    if not finite.all():
        raise InputError(f"{path}: t is not a number in {int((~finite).sum())} of {len(finite)} samples")
    samples, order_notes = in_order(samples, str(path))
    start = float(samples.stamp[0])
    start_ns = round(start * 1e9) if 0.0 < start < LONGEST else 0
    t = np.asarray(samples.stamp, dtype=float) - start
    return Recording(names, t, samples.q, samples.tau, samples.dq, str(path), tuple(notes + order_notes), start_ns)


def write_table(path: Path, form: str, arrays: Mapping[str, Any], digits: int = 17) -> None:
    """Write arrays as the file that `read_csv` or `read_npz` reads: `t` [N], `names` [n], all others [N, n].

    form: `.npz` or `.csv`, whose numbers have so many digits.
    """
    if form == ".npz":
        with path.open("wb") as file:
            np.savez(file, **arrays)
        return
    columns = {key: values for key, values in arrays.items() if key not in ("t", "names")}
    header = ["t", *(f"{key}_{name}" for key in columns for name in arrays["names"])]
    rows = np.column_stack([arrays["t"], *columns.values()])
    np.savetxt(path, rows, fmt=f"%.{digits}g", delimiter=",", header=",".join(header), comments="")

"""Tables: round trips, and every way in which one can be wrong named by row, column or array."""

from __future__ import annotations

import warnings
import zipfile
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from robot_ident.bags import describe, read_recording, write_recording
from robot_ident.errors import InputError

GOOD = "t,q_a,tau_a\n0,1,2\n.1,3,4\n"


@pytest.fixture(autouse=True)
def _no_warnings() -> Any:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        yield


@pytest.mark.parametrize("suffix", [".csv", ".npz"])
@pytest.mark.parametrize("velocity", [True, False])
@pytest.mark.parametrize("joints", [1, 3])
def test_round_trip(tmp_path: Path, maker: SimpleNamespace, suffix: str, velocity: bool, joints: int) -> None:
    recording = maker.make_recording(100, joints, velocity=velocity)
    path = tmp_path / f"a{suffix}"
    write_recording(path, recording)
    got = read_recording(path)
    assert got.notes == ()
    for field in ("names", "t", "q", "tau", "dq"):
        np.testing.assert_array_equal(getattr(got, field), getattr(recording, field))
    assert describe(path).topics[0].joints == recording.names
    names = recording.names[::-1]
    np.testing.assert_array_equal(read_recording(path, joints=names).q, recording.q[:, ::-1])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "the file is empty"),
        ("\n\n# only a comment\n", "the file is empty"),
        ("t,q_a,tau_a\n", "has a header but no rows"),
        ("q_a,tau_a\n1,2\n", "column 't' is missing"),
        ("t,a,b\n1,2,3\n", "column 'q_NAME' is missing"),
        ("t,q_a,tau_b\n1,2,3\n", "column 'tau_a' is missing; did you mean 'tau_b'?"),
        ("t,q_a,q_a,tau_a\n1,2,3,4\n", "column 'q_a' stands in the header 2 times"),
        (GOOD + ".2,x,6\n", "row 4, column 'q_a': 'x' is not a number"),
        (GOOD + ".2,5,nan\n", "row 4, column 'tau_a': 'nan' is not a number"),
        (GOOD + ".2,,6\n", "row 4, column 'q_a': '' is not a number"),
        (GOOD + "inf,5,6\n", "row 4, column 't': 'inf' is not a number"),
        (GOOD + ".2,5\n", "row 4 has 2 cells; column 'tau_a' is missing"),
        (GOOD + "\n# pause\n.2,1e,6\n", "row 6, column 'q_a': '1e' is not a number"),
    ],
)
def test_wrong_csv(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "a.csv"
    path.write_text(text)
    with pytest.raises(InputError) as caught:
        read_recording(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_binary_csv(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    for content in (b"\xff\xfe\x00t", bytes(range(256)) * 4, GOOD.encode() + b"\xff,1,2\n"):
        path.write_bytes(content)
        with pytest.raises(InputError, match=r"a\.csv: "):
            read_recording(path)


@pytest.mark.parametrize("delimiter", [",", ";", "\t"])
def test_csv_of_a_spreadsheet(tmp_path: Path, delimiter: str) -> None:
    """A byte order mark, spaces, other delimiters, Windows line ends, columns of no interest, a comment above."""
    path = tmp_path / "a.csv"
    text = "# made by hand\r\n t , remark,tau_a,q_a \r\n5,x,2,1\r\n5.5,y,4,3\r\n".replace(",", delimiter)
    path.write_bytes(b"\xef\xbb\xbf" + text.encode())
    got = read_recording(path)
    assert got.t.tolist() == [0, 0.5]
    assert got.q.tolist() == [[1], [3]]
    assert got.tau.tolist() == [[2], [4]]
    assert got.start_ns == 5_000_000_000
    assert got.notes == ("columns not used: remark",)


def test_csv_out_of_order(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("t,q_a,tau_a\n0,0,0\n2,2,2\n1,1,1\n2,2,2\n3,3,3\n")
    got = read_recording(path)
    assert got.t.tolist() == [0, 1, 2, 3]
    assert len(got.notes) == 2


def test_csv_missing_joint(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text(GOOD)
    with pytest.raises(InputError, match="column 'q_b' is missing"):
        read_recording(path, joints=["a", "b"])


ARRAYS: dict[str, Any] = {
    "t": np.arange(5.0),
    "q": np.ones((5, 2)),
    "tau": np.ones((5, 2)),
    "names": np.array(["a", "b"]),
}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"t": None}, "array 't' is missing; it has names, q, tau"),
        ({"tau": None}, "array 'tau' is missing"),
        ({"tau": np.ones((5, 3))}, "tau must have the shape [5, 2] as t and q say, it has [5, 3]"),
        ({"q": np.ones((4, 2))}, "q must have the shape [5, 2] as t and q say, it has [4, 2]"),
        ({"q": np.ones((5, 2, 1))}, "it has [5, 2, 1]"),
        ({"dq": np.ones((2, 5))}, "dq must have the shape [5, 2]"),
        ({"t": np.ones((5, 1))}, "t must have the shape [N] with N > 0, it has [5, 1]"),
        ({"t": np.empty(0)}, "t must have the shape [N] with N > 0"),
        ({"q": np.ones((5, 2), dtype=complex)}, "q must hold real numbers, it holds complex128"),
        ({"q": np.full((5, 2), "x")}, "q must hold real numbers"),
        ({"q": np.array([[None, {}]] * 5)}, "q can't be loaded (it is pickled; save plain arrays of numbers)"),
        ({"names": np.array(["a", "a"])}, "names must be 2 different words, they are a, a"),
        ({"names": np.array(["a"])}, "names must be 2 different words"),
        ({"q": np.full((5, 2), np.nan)}, "q is not a number in 5 of 5 samples"),
        ({"t": np.full(5, np.nan)}, "t is not a number in 5 of 5 samples"),
    ],
)
def test_wrong_npz(tmp_path: Path, change: dict[str, Any], message: str) -> None:
    path = tmp_path / "a.npz"
    arrays = {key: value for key, value in (ARRAYS | change).items() if value is not None}
    np.savez(path, **arrays)
    with pytest.raises(InputError) as caught:
        read_recording(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_one_joint_without_names(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    np.savez(path, t=np.arange(5), q=np.arange(5.0), tau=-np.arange(5.0), something_else=np.array([{}], dtype=object))
    got = read_recording(path)
    assert got.names == ("joint_1",)
    assert got.q[:, 0].tolist() == [0, 1, 2, 3, 4]


def test_damaged_npz(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    np.savez_compressed(path, **ARRAYS)
    content = np.frombuffer(path.read_bytes(), dtype=np.uint8)
    random = np.random.default_rng(0)
    for k in range(200):
        damaged = content[: random.integers(0, len(content))].copy() if k % 4 == 0 else content.copy()
        if len(damaged):
            damaged[random.integers(0, len(damaged), 2)] = random.integers(0, 256, 2)
        path.write_bytes(damaged.tobytes())
        try:
            read_recording(path)
        except InputError as error:
            assert str(error).startswith(f"{path}: ")
            assert "\n" not in str(error)


def test_header_that_claims_terabytes(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    header = b"{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000000,), }".ljust(117) + b"\n"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("t.npy", b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header + bytes(80))
    with pytest.raises(InputError, match="t can't be loaded"):
        read_recording(path)


@pytest.mark.parametrize("cut", [1, 9, 40, 70])
def test_csv_that_breaks_off_in_its_last_row(tmp_path: Path, maker: SimpleNamespace, cut: int) -> None:
    recording = maker.make_recording(40, 2)
    write_recording(tmp_path / "whole.csv", recording)
    text = (tmp_path / "whole.csv").read_text()
    assert cut < len(text.splitlines()[-1])
    (tmp_path / "cut.csv").write_text("# exported\n" + text[:-cut])
    got = read_recording(tmp_path / "cut.csv")
    assert got.samples == 39
    np.testing.assert_array_equal(got.tau, recording.tau[:39])
    assert any("last row has no line end and is left out" in note for note in got.notes)
    whole = read_recording(tmp_path / "whole.csv")
    assert whole.samples == 40
    assert whole.notes == ()

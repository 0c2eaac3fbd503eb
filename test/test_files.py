"""Output files appear whole or not at all, and nothing that was measured is lost for them."""

from __future__ import annotations

from pathlib import Path

import pytest

from robot_ident.errors import InputError
from robot_ident.files import read_text, refuse_twice, whole, write_text


def make(draft: Path, text: str) -> None:
    draft.mkdir()
    (draft / "metadata.yaml").write_text(text)


def test_a_folder_takes_the_place_of_a_file_and_of_a_recording(tmp_path: Path) -> None:
    target = tmp_path / "out"
    target.write_text("old")
    for text in ("first", "second"):
        with whole(target, force=True) as draft:
            make(draft, text)
        assert (target / "metadata.yaml").read_text() == text
    assert [entry.name for entry in tmp_path.iterdir()] == ["out"]


def test_a_text_takes_the_place_of_no_recording(tmp_path: Path) -> None:
    recording = tmp_path / "recording"
    make(recording, "measured")
    with pytest.raises(InputError, match="is a folder"):
        write_text(recording, "text", force=True)
    assert (recording / "metadata.yaml").read_text() == "measured"


def test_what_was_there_comes_back_when_the_new_one_is_missing(tmp_path: Path) -> None:
    recording = tmp_path / "recording"
    make(recording, "measured")
    with pytest.raises(InputError, match="can't be written"), whole(recording, force=True):
        pass  # nothing was made
    assert (recording / "metadata.yaml").read_text() == "measured"
    assert [entry.name for entry in tmp_path.iterdir()] == ["recording"]


def test_a_recording_that_is_given_twice(tmp_path: Path) -> None:
    (tmp_path / "a.npz").touch()
    (tmp_path / "link.npz").symlink_to("a.npz")
    refuse_twice([tmp_path / "a.npz", tmp_path / "b.npz"])
    with pytest.raises(InputError, match="link.npz is given twice"):
        refuse_twice([tmp_path / "a.npz", tmp_path / "link.npz"])


def test_what_no_file_can_be_called() -> None:
    with pytest.raises(InputError, match="is no name of a file"):
        read_text("a\0b")

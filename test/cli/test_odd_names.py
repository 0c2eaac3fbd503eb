"""Names that no file can have, and names of devices and pipes: one line, exit code 2, and nothing is lost."""

from __future__ import annotations

import os
import stat
from pathlib import Path

import pytest

from robot_ident.bags import write_recording
from robot_ident.cli.main import main
from robot_ident.configuration import read_yaml
from robot_ident.errors import InputError
from robot_ident.files import read_text, refuse_existing, whole, write_text
from robot_ident.robot import load_robot

LONG = "n" * 300
INPUTS = Path(__file__).parents[1] / "golden" / "inputs"
EMPTY = [
    ["identify", ""],
    ["identify", str(INPUTS / "kuka_1.npz"), "-o", ""],
    ["identify", str(INPUTS / "kuka_1.npz"), "--robot", ""],
    ["info", ""],
    ["check", ""],
    ["check", str(INPUTS / "excitation_1.yaml"), "--model", ""],
    ["simulate", str(INPUTS / "excitation_1.yaml"), "--output="],
    ["export", "model.yaml", "--c", ""],
    ["report", "model.yaml", "--bag", "", "-o", "report.html"],
    ["demo", "--folder", " "],
    ["effects", "--effects-from", ""],
]


def refused(words: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    """Return the one line with which the command line refuses words."""
    try:
        code = main(words)
    except SystemExit as end:
        code = int(end.code or 0)
    told = capsys.readouterr()
    assert (code, told.out, told.err.count("\n")) == (2, "", 1), told.err
    assert told.err.startswith(f"robot_ident {words[0]}: ")
    return told.err


@pytest.mark.parametrize("words", EMPTY, ids=" ".join)
def test_an_empty_word(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert "is empty" in refused(words, capsys)


def test_an_empty_output_of_the_library(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("", ".", "/"):
        with pytest.raises(InputError):
            write_text(name, "text", force=True)
    assert not list(tmp_path.iterdir())


@pytest.fixture(params=["pipe", "device", "link to a pipe"])
def special(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    """A pipe or a device, made here, that nobody feeds or needs."""
    path = tmp_path / "special"
    if request.param == "device":
        try:
            os.mknod(path, stat.S_IFCHR | 0o600, os.makedev(1, 3))
        except OSError:
            pytest.skip("only the administrator makes devices")
        return path
    os.mkfifo(path)
    if request.param == "pipe":
        return path
    (tmp_path / "link").symlink_to(path)
    return tmp_path / "link"


def test_a_device_or_a_pipe_is_no_output(special: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = os.lstat(special)
    for force in ([], ["--force"]):
        for words in (
            ["simulate", str(INPUTS / "excitation_1.yaml"), "--periods", "1", "-o"],
            ["identify", str(INPUTS / "kuka_1.npz"), "-o"],
            ["export", "model.yaml", "--c"],
        ):
            assert "device, a pipe or a socket" in refused([*words, str(special), *force], capsys)
        with pytest.raises(InputError, match="device, a pipe or a socket"):
            refuse_existing(special, force=bool(force))
        with pytest.raises(InputError, match="device, a pipe or a socket"), whole(special, force=bool(force)):
            pass
    after = os.lstat(special)
    assert (before.st_mode, before.st_ino, before.st_rdev) == (after.st_mode, after.st_ino, after.st_rdev)


def test_a_device_or_a_pipe_is_no_input(special: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for words in (["info"], ["identify"], ["check"], ["identify", str(INPUTS / "kuka_1.npz"), "--trajectory"]):
        assert "device, a pipe or a socket" in refused([*words, str(special)], capsys)
    for read in (read_text, read_yaml):
        with pytest.raises(InputError, match="device, a pipe or a socket"):
            read(special)
    robot = special.with_name("robot.yaml")
    robot.write_text(f"schema: robot_ident/robot/1\nname: odd\nurdf: {special}\n")
    with pytest.raises(InputError, match="device, a pipe or a socket"):
        load_robot(robot)
    (special.parent / "bag.npz.conditions.yaml").symlink_to(special)
    (special.parent / "bag.npz").write_bytes((INPUTS / "kuka_1.npz").read_bytes())
    assert "device, a pipe or a socket" in refused(["identify", str(special.parent / "bag.npz")], capsys)


def test_what_a_process_has_open_is_no_output(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with (tmp_path / "open").open("w") as file:
        name = f"/proc/self/fd/{file.fileno()}"
        words = ["identify", str(INPUTS / "kuka_1.npz"), "-o", name, "--force"]
        assert "among the machine's devices" in refused(words, capsys)


def test_a_text_beyond_any_size(tmp_path: Path) -> None:
    path = tmp_path / "large.yaml"
    with path.open("wb") as file:
        file.truncate((64 << 20) + 1)  # a hole: takes no room
    with pytest.raises(InputError, match="large.yaml has more than 64 MiB"):
        read_yaml(path)


@pytest.mark.parametrize("suffix", ["", ".yaml", ".mcap", ".npz"])
def test_a_name_too_long_for_an_output(suffix: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    output = str(tmp_path / f"{LONG}{suffix}")
    for words in (
        ["simulate", str(INPUTS / "excitation_1.yaml"), "--periods", "1", "-o", output],
        ["identify", str(INPUTS / "kuka_1.npz"), "-o", output],
        ["recover", str(INPUTS / "torn.mcap"), "-o", output],
        ["init", "--urdf", str(INPUTS / "six_axis.urdf"), "-o", output],
        ["export", "model.yaml", "--c", output],
        ["export", "model.yaml", "--urdf", output],
        ["demo", "--folder", output],
        ["info", output],
        ["check", output],
        ["simulate", output, "-o", str(tmp_path / "out")],
        ["check", str(INPUTS / "excitation_1.yaml"), "--robot", output],
    ):
        assert "n" * 30 in refused(words, capsys)
    assert not list(tmp_path.iterdir())


def test_a_long_name_that_a_file_can_have(tmp_path: Path) -> None:
    write_text(tmp_path / ("n" * 250), "text")
    assert [path.read_text() for path in tmp_path.iterdir()] == ["text"]


def test_a_bag_whose_files_have_names_too_long(tmp_path: Path) -> None:
    from robot_ident.bags import read_recording

    with pytest.raises(InputError, match="can't be written"):
        write_recording(tmp_path / ("n" * 250), read_recording(INPUTS / "kuka_1.npz"))
    assert not list(tmp_path.iterdir())

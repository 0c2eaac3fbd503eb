"""Outputs that would destroy what is read, or each other, are refused before any work."""

from __future__ import annotations

from pathlib import Path

import pytest

from robot_ident.cli.main import main


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("identify {bag} -o {bag} --force", "the name of a file was expected"),
        ("recover {bag} -o {bag}/ --force", "is read as a recording"),
        ("predict model.yaml {bag} -o {bag} --force", "is read as a recording"),
        ("predict model.yaml {table} -o {table} --force", "is read as a recording"),
        ("identify {table} --robot {robot} -o {robot} --force", "is read by this command"),
        ("identify {table} --trajectory {robot} -o {robot} --force", "is read by this command"),
        ("report {robot} --bag {table} -o {robot} --force", "is read by this command"),
        ("design -o {page} --page {page} --force", "two outputs need two names"),
        ("design --trajectories 2 -o .", "is a folder"),
    ],
)
def test_no_output_takes_the_place_of_an_input(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], words: str, message: str
) -> None:
    bag, table = tmp_path / "recording", tmp_path / "table.npz"
    bag.mkdir()
    (bag / "metadata.yaml").write_text("measured")
    table.write_bytes(b"measured")
    robot = tmp_path / "robot.yaml"
    robot.write_text("a robot")
    given = words.format(bag=bag, table=table, robot=robot, page=tmp_path / "x.yaml").split()
    assert main(given) == 2
    written = capsys.readouterr()
    assert message in written.err and written.err.count("\n") == 1 and not written.out
    assert robot.read_text() == "a robot"
    assert (bag / "metadata.yaml").read_text() == "measured" and table.read_bytes() == b"measured"

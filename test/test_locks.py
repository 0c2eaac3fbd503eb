"""The locks hold every package that setup.py asks for, within its ranges, with hashes and from no registry by name."""

from __future__ import annotations

import re
from importlib import metadata
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

LOCKS = ("build", "run", "test", "dds")


def pins(lock: Path) -> dict[str, Requirement]:
    """Return what a lock installs here, by name."""
    lines = re.sub(r"\\\n", "", lock.read_text(encoding="utf-8")).splitlines()
    found = [Requirement(line.partition("--hash")[0]) for line in lines if line and not line.startswith("#")]
    here = [it for it in found if it.marker is None or it.marker.evaluate()]
    assert len({canonicalize_name(it.name) for it in here}) == len(here)
    return {canonicalize_name(it.name): it for it in here}


def wanted(extras: set[str]) -> list[Requirement]:
    """Return what an installation with these extras needs."""
    found = [Requirement(line) for line in metadata.requires("robot_ident") or ()]
    return [it for it in found if it.marker is None or any(it.marker.evaluate({"extra": e}) for e in ("", *extras))]


@pytest.mark.parametrize(("lock", "extras"), [("run", {"ros"}), ("test", {"ros", "test"})])
def test_a_lock_fits_the_ranges(checkout: Path, lock: str, extras: set[str]) -> None:
    pinned = pins(checkout / "requirements" / f"{lock}.txt")
    for one in wanted(extras):
        (pin,) = pinned[canonicalize_name(one.name)].specifier
        assert pin.operator == "==" and one.specifier.contains(pin.version), f"{one}: `make lock` renews {lock}.txt"


def test_locks_agree(checkout: Path) -> None:
    run, test = (pins(checkout / "requirements" / f"{lock}.txt") for lock in ("run", "test"))
    assert {name: str(it.specifier) for name, it in run.items()}.items() <= {
        name: str(it.specifier) for name, it in test.items()
    }.items()


@pytest.mark.parametrize("lock", LOCKS)
def test_every_package_has_its_hashes_and_no_registry_is_named(checkout: Path, lock: str) -> None:
    text = (checkout / "requirements" / f"{lock}.txt").read_text(encoding="utf-8")
    assert not re.search(r"https?://|--(extra-)?index-url|--find-links|file:", text)
    for block in re.split(r"\n(?=\S)", text.partition("\n\n")[2] or text):
        assert block.startswith("#") or "--hash=sha256:" in block, block

"""What an export is: the text of its files, the effects that they carry, and what a user has to know."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

CHOICE = "the torque tells combinations alone: masses and centres of single links are one choice of many"
"""What every format that holds single links has to say."""


@dataclass(frozen=True)
class Exported:
    """files: text by name within the folder, or under "" where the export is a single file. carried, left: effects as
    `name@joint` that the format holds and those that it can't. notes: one line each.
    """

    files: Mapping[str, str]
    carried: tuple[str, ...]
    left: tuple[str, ...]
    notes: tuple[str, ...]

"""What recordings are proposed for."""

from __future__ import annotations

from dataclasses import replace

import pytest

from robot_ident.workbench.file_roles import Seen, propose

FIRST = Seen(160.0, 16, 10.0, 150.0, (0.1, -0.2), (0.5, 0.4))
AGAIN = replace(FIRST, seconds=80.0, periods=8, mean=(0.11, -0.19))
SECOND = replace(FIRST, mean=(0.4, -0.2), spread=(0.3, 0.4))
THIRD = replace(SECOND, seconds=40.0, periods=4, mean=(0.1, 0.6))
ONCE = Seen(25.0, 1, 25.0, 1000.0, (0.0, 0.3), (0.6, 0.2))
OTHER = replace(ONCE, seconds=12.0, period=12.0)
THREE = replace(ONCE, mean=(0.5, 0.3))


@pytest.mark.parametrize(
    ("seen", "roles", "said"),
    [
        ({"a": FIRST}, "t", "a for training; a second, different motion"),
        ({"a": FIRST, "b": AGAIN}, "tt", "a and b for training; a second, different motion"),
        ({"a": FIRST, "b": SECOND}, "tt", "a and b for training. "),
        ({"a": FIRST, "b": SECOND, "c": THIRD}, "ttv", "c holds a motion of its own"),
        ({"a": THIRD, "b": SECOND, "c": FIRST, "d": AGAIN}, "vttt", "b, c and d for training; a holds"),
        ({"a": ONCE, "b": FIRST}, "vt", "a does not repeat, and is kept for validation; a second"),
        ({"a": FIRST, "b": ONCE, "c": OTHER, "d": SECOND}, "tvvt", "b and c do not repeat, and are kept"),
        ({"a": ONCE, "b": OTHER}, "tt", "a and b for training. "),
        ({"a": ONCE, "b": OTHER, "c": THREE}, "tvt", "b holds a motion of its own"),
        ({"a": None, "b": FIRST}, "nt", "b for training"),
        ({"a": None}, "n", "choose another one below"),
    ],
)
def test_roles_follow_from_what_recordings_hold(seen: dict[str, Seen | None], roles: str, said: str) -> None:
    proposed, words = propose(seen)
    assert "".join(proposed[name][0] for name in seen) == roles
    assert said in words


def test_a_motion_is_known_again_by_its_positions() -> None:
    assert FIRST.same_motion(AGAIN)
    assert not FIRST.same_motion(SECOND)
    assert not FIRST.same_motion(replace(FIRST, period=5.0))
    assert FIRST.in_words == "16 periods of 10 s, 150 Hz"
    assert OTHER.in_words == "12 s, once, 1000 Hz"

"""Any arm: from its URDF by `init`, `design`, `check`, `simulate`, `identify`, `validate`; no edit but of limits."""

from __future__ import annotations

from pathlib import Path

import pytest
from arms_of_wheel import ARMS, whole_way

SECONDS = 6.0
"""Of search for each of two motions: enough for a motion that shows every parameter, not for the best."""


@pytest.mark.parametrize("arm", ARMS)
def test_any_arm(arm: str, tmp_path: Path) -> None:
    found = whole_way(arm, tmp_path, seconds=SECONDS)
    worst = max(found["relative"].values())
    print(
        f"\n{arm}: {found['axes']} axes, {found['edited']} limits filled in, {found['parameters']} parameters,"
        f" error on another motion at most {100 * worst:.3g} % of the torque"
    )
    assert found["axes"] == ARMS[arm][1]
    assert worst < 0.01, found["relative"]

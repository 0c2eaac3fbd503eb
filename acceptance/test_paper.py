"""The paper's loop closed on other noises: all that is hidden is named, nothing else, and the model is adequate."""

from __future__ import annotations

import pytest

from robot_ident.paper.study import Study


@pytest.mark.parametrize("seed", range(1, 5))
def test_the_loop_closes_whatever_the_noise(seed: int) -> None:
    """A small part of a large shift is no delay, and offsets of two joints show only together."""
    found = Study(seed=seed, quick=True).missing
    assert set(found.named) == set(found.truth)
    assert found.said[-1].verdict == "adequate"

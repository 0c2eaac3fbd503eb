"""A clock that is set, told from one that is slewed and from a process that stood still."""

from __future__ import annotations

import pytest

from robot_ident.playback.stamps import SetClock


class Clocks:
    """The machine's two clocks [ns]; `between`: how long it takes to look from one to the other."""

    def __init__(self) -> None:
        self.monotonic, self.ahead, self.between = 10**12, 10**18, 0

    def now_ns(self) -> int:
        self.monotonic += self.between
        return self.monotonic + self.ahead

    def monotonic_ns(self) -> int:
        return self.monotonic


@pytest.mark.parametrize("by", [5.0, -5.0, 0.1])
def test_a_step_is_told_once(by: float) -> None:
    clocks = Clocks()
    watch = SetClock(clocks.now_ns, clocks.monotonic_ns)
    assert watch.step() == 0.0
    clocks.monotonic += 10**9
    assert watch.step() == 0.0
    clocks.ahead += round(by * 1e9)
    assert watch.step() == pytest.approx(by)
    assert watch.step() == 0.0


def test_a_process_that_stood_still_between_two_looks_saw_no_step() -> None:
    clocks = Clocks()
    watch = SetClock(clocks.now_ns, clocks.monotonic_ns)
    watch.step()
    clocks.between = 400_000_000
    assert watch.step() == 0.0
    clocks.between = 0
    assert watch.step() == 0.0

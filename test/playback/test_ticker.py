"""Deadlines: nothing adds up, what is missed is counted, a clock that jumps moves the grid."""

from __future__ import annotations

import os
import threading
import time

import pytest

from robot_ident.playback.periodic_timer import Stall, Ticker, follow_at, follow_no_more


def run(ticker: Ticker, done: threading.Event) -> None:
    ticker.start()
    assert done.wait(20.0)
    ticker.stop()


def test_ticks_are_numbered_and_absolute() -> None:
    numbers: list[int] = []
    times: list[float] = []
    done = threading.Event()

    def tick(number: int) -> None:
        numbers.append(number)
        times.append(time.monotonic())
        if number >= 100:
            done.set()

    ticker = Ticker(200.0, tick, stall=5.0)
    run(ticker, done)
    assert numbers == sorted(set(numbers))
    assert numbers[-1] == len(numbers) - 1 + ticker.timing.missed
    early = [t - times[0] - k / 200.0 for t, k in zip(times, numbers, strict=True)]
    assert min(early) > -0.5 / 200.0, "a tick came before its time"


def test_ticks_alone_run_before_all_else_where_that_is_allowed() -> None:
    found: dict[str, tuple[int, int]] = {}
    done = threading.Event()
    tickers: list[Ticker] = []

    def look(name: str) -> None:
        found[name] = os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK, os.sched_getparam(0).sched_priority

    def tick(number: int) -> None:
        look("ticker")
        done.set()

    def follower() -> None:
        if not follow_at(7):
            done.set()
            return
        look("follower")
        tickers.append(Ticker(200.0, tick, priority=7))
        tickers[0].start()
        other = threading.Thread(target=look, args=("other",))
        other.start()
        other.join()
        follow_no_more()
        look("at the end")

    thread = threading.Thread(target=follower)
    thread.start()
    thread.join()
    assert done.wait(20.0)
    for ticker in tickers:
        ticker.stop()
    if not found:
        pytest.skip("no real-time priority is allowed on this machine")
    assert found == {
        "follower": (os.SCHED_FIFO, 6),
        "ticker": (os.SCHED_FIFO, 7),
        "other": (os.SCHED_OTHER, 0),
        "at the end": (os.SCHED_OTHER, 0),
    }


def test_the_end_waits_for_the_last_tick() -> None:
    """What a tick uses is destroyed after that: a publisher, the node."""
    begun, free = threading.Event(), threading.Event()
    done: list[int] = []

    def tick(number: int) -> None:
        begun.set()
        free.wait(20.0)
        time.sleep(0.2)
        done.append(number)

    ticker = Ticker(100.0, tick, stall=30.0)
    ticker.start()
    assert begun.wait(20.0)
    threading.Timer(1.5, free.set).start()
    ticker.stop()
    assert done == [0]


def test_a_slow_tick_is_skipped_or_made_up_for() -> None:
    for late, expected in (("skip", False), ("catch_up", True)):
        numbers: list[int] = []
        done = threading.Event()

        def tick(number: int, numbers: list[int] = numbers, done: threading.Event = done) -> None:
            numbers.append(number)
            if number == 5:
                time.sleep(0.055)
            if number >= 40:
                done.set()

        ticker = Ticker(100.0, tick, late=late, stall=10.0)  # type: ignore[arg-type]
        run(ticker, done)
        assert (numbers == list(range(len(numbers)))) is expected
        assert (ticker.timing.missed == 0) is expected
        if not expected:
            assert ticker.timing.missed >= 4
            assert numbers[-1] == len(numbers) - 1 + ticker.timing.missed


def test_a_stall_moves_the_grid_and_is_told() -> None:
    numbers: list[int] = []
    stalls: list[Stall] = []
    done = threading.Event()

    def tick(number: int) -> None:
        numbers.append(number)
        if number == 5:
            time.sleep(0.5)
        if number == 40:
            done.set()

    ticker = Ticker(100.0, tick, late="catch_up", stall=0.3, on_stall=stalls.append)
    run(ticker, done)
    assert stalls and stalls[0].seconds > 0.3 and not stalls[0].clock_jump
    assert "stood still" in str(stalls[0])
    assert 6 in numbers, "the tick after the stall is the next one, not one of the past or of the future"


def test_ticks_are_due_on_the_grid_that_a_stall_has_moved() -> None:
    """What the report of a stall takes, or a clock that goes on meanwhile, is made up for: it moves nothing again."""
    due: list[tuple[int, float]] = []
    done = threading.Event()

    def tick(number: int) -> None:
        due.append((number, time.monotonic() - ticker.late))
        if number == 5:
            time.sleep(0.5)
        if number == 40:
            done.set()

    ticker = Ticker(100.0, tick, late="catch_up", stall=0.3, on_stall=lambda _: time.sleep(0.15))
    run(ticker, done)
    after = [instant - 0.01 * number for number, instant in due if number > 5]
    assert max(after) - min(after) < 0.02
    assert due[6][1] - due[5][1] > 0.3


def test_a_jump_of_a_foreign_clock_is_told() -> None:
    offset = [0.0]
    stalls: list[Stall] = []
    numbers: list[int] = []
    done = threading.Event()

    def tick(number: int) -> None:
        numbers.append(number)
        if number == 10:
            threading.Timer(0.003, lambda: offset.__setitem__(0, 5.0)).start()
        if number == 20:
            threading.Timer(0.003, lambda: offset.__setitem__(0, -5.0)).start()
        if number == 40:
            done.set()

    clock = lambda: time.monotonic() + offset[0]  # noqa: E731
    run(Ticker(50.0, tick, late="catch_up", stall=1.0, on_stall=stalls.append, clock=clock), done)
    jumps = [stall for stall in stalls if stall.clock_jump]
    assert len(jumps) == 2 and jumps[0].seconds > 4.0 and jumps[1].seconds < -9.0
    assert numbers[:41] == list(range(41))


def test_a_jump_during_a_tick_is_one_as_well() -> None:
    """The clock must not run for seconds without a command because nobody looked when it went back."""
    offset = [0.0]
    stalls: list[Stall] = []
    done = threading.Event()

    def tick(number: int) -> None:
        if number in (10, 20):
            offset[0] += 5.0 if number == 10 else -5.0
        if number == 30:
            done.set()

    clock = lambda: time.monotonic() + offset[0]  # noqa: E731
    run(Ticker(50.0, tick, late="catch_up", stall=1.0, on_stall=stalls.append, clock=clock), done)
    assert [stall.clock_jump for stall in stalls] == [True, True]
    assert stalls[0].seconds > 4.0 and stalls[1].seconds < -4.0


@pytest.mark.parametrize("silent", [0.03, 0.3])
def test_after_a_standstill_the_clock_is_heard_first(silent: float) -> None:
    """A process that wakes has a foreign clock's old word at hand; a tick by it would be a command for the past.

    Where the clock takes long to be heard, what it says then is still no jump.
    """
    behind = [0.0]
    stalls: list[Stall] = []
    numbers: list[tuple[int, int]] = []
    done = threading.Event()

    def clock() -> float:
        return behind[1] if len(behind) > 1 else time.monotonic()

    def tick(number: int) -> None:
        numbers.append((number, len(stalls)))
        if number == 10:
            behind.append(time.monotonic() + 0.03)  # by which the next tick would be due
            time.sleep(1.3)
            threading.Timer(silent, behind.pop).start()
        if number == 30:
            done.set()

    run(Ticker(50.0, tick, late="catch_up", stall=1.0, on_stall=stalls.append, clock=clock), done)
    assert [stall.clock_jump for stall in stalls] == [False]
    at_most = 0 if silent < 0.1 else 1  # one tick is due by the old word
    assert sum(number > 10 and before == 0 for number, before in numbers) <= at_most


def test_a_standstill_amid_a_look_at_the_clock_is_none_of_its_jumps() -> None:
    """A clock that runs twice as fast is read just before the process stands still, and the machine's just after."""
    stalls: list[Stall] = []
    stand_still, done = threading.Event(), threading.Event()

    def clock() -> float:
        now = 2.0 * time.monotonic()
        if stand_still.is_set():
            stand_still.clear()
            time.sleep(1.5)
        return now

    def tick(number: int) -> None:
        if number == 10:
            threading.Timer(0.005, stand_still.set).start()
        if number == 30:
            done.set()

    run(Ticker(50.0, tick, late="catch_up", stall=1.0, on_stall=stalls.append, clock=clock), done)
    assert [stall.clock_jump for stall in stalls] == [False]
    assert stalls[0].seconds > 2.5


def test_an_error_in_a_tick_reaches_the_owner() -> None:
    errors: list[BaseException] = []
    told = threading.Event()

    def broken(number: int) -> None:
        raise ZeroDivisionError(number)

    def on_error(error: BaseException) -> None:
        errors.append(error)
        told.set()

    ticker = Ticker(100.0, broken, on_error=on_error)
    run(ticker, told)
    assert isinstance(errors[0], ZeroDivisionError)

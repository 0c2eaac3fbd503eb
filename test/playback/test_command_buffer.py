"""Commands wait for their time, whatever their way took."""

from __future__ import annotations

import numpy as np

from robot_ident.playback.commands import CommandBuffer

S = 1_000_000_000
Q = np.zeros(2)


def test_commands_come_out_at_their_time_and_in_order() -> None:
    buffer = CommandBuffer(0.05)
    for k in (0, 10, 20, 15, 20, 30):  # ms; 15 and the second 20 are older than, or as old as, what came before
        buffer.put(100 * S + k * 1_000_000, 100 * S + 40_000_000, Q + k, Q)
    assert buffer.due(100 * S + 49_999_999) == []
    assert [c.q[0] for c in buffer.due(100 * S + 70_000_000)] == [0.0, 10.0, 20.0]
    assert [c.q[0] for c in buffer.due(101 * S)] == [30.0]
    assert buffer.due(102 * S) == []


def test_a_stamp_of_another_clock_is_replaced() -> None:
    buffer = CommandBuffer(0.0)
    buffer.put(0, 100 * S, Q, Q)
    buffer.put(5 * S, 101 * S, Q, Q)
    assert [c.t_ns for c in buffer.due(200 * S)] == [100 * S, 101 * S]
    buffer.put(202 * S, 202 * S, Q, Q)
    buffer.clear()
    assert buffer.due(300 * S) == []


def test_commands_that_nobody_took_keep_their_stamps() -> None:
    """A robot that stood still for 3 s is not sent where it was to be then: the stamps are of its own clock."""
    buffer = CommandBuffer(0.2)
    buffer.put(100 * S, 100 * S, Q, Q)
    for k in range(1, 31):
        buffer.put(100 * S + k * S // 10, 103 * S, Q + k, Q)
    assert [c.t_ns for c in buffer.due(103 * S)] == [100 * S + k * S // 10 for k in range(29)]
    buffer.put(50 * S, 104 * S, Q, Q)
    assert [c.t_ns for c in buffer.due(110 * S)][-1] == 104 * S, "another sender's clock, long behind"


def test_what_waits_goes_along_with_a_clock_that_jumps() -> None:
    buffer = CommandBuffer(0.1)
    for k in range(3):
        buffer.put(100 * S + k * 10_000_000, 100 * S, Q + k, Q)
    buffer.shift(-5 * S)
    buffer.put(95 * S + 30_000_000, 95 * S, Q + 3, Q)
    assert [c.q[0] for c in buffer.due(95 * S + 110_000_000)] == [0.0, 1.0]
    assert [c.q[0] for c in buffer.due(96 * S)] == [2.0, 3.0]

"""A certifier that is prepared leaves nothing to make to the thread that uses it, and certifies the same."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import casadi as ca
import numpy as np
import pytest

from robot_ident.limits.certifier import Certifier
from robot_ident.limits.feasibility import allowed_poses
from robot_ident.planning.approach import NotWanted, approach
from robot_ident.planning.stop import stop_from
from robot_ident.robot import Robot
from robot_ident.signals.motion import Motion


@contextmanager
def nothing_made(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Let no expression and no function of CasADi be made; those that are there may be called."""

    def refuse(*args: Any, **kwargs: Any) -> None:
        raise AssertionError("an expression of CasADi is made by the thread that plans")

    with monkeypatch.context() as patch:
        for name in ("SX", "MX", "Function"):
            patch.setattr(getattr(ca, name), "__init__", refuse)
        yield


def plans(robot: Robot, ends: Any, certifier: Certifier | None) -> list[Any]:
    """Return what a publisher plans: an approach, and a stop from full speed."""
    way = approach(ends[0], ends[1], robot, certifier=certifier)
    speed = 0.5 * robot.limits.velocity[None]
    stop = stop_from(Motion(ends[:1], speed, 0.0 * speed), robot, certifier)
    return [way.points, stop.coefficients, stop.durations, stop.certified]


@pytest.mark.parametrize("name", ["kuka", "ur10"])
def test_a_prepared_certifier_makes_nothing(
    name: str, request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch
) -> None:
    robot = request.getfixturevalue(name)
    ends = allowed_poses(robot, 2)[:2]
    expected = plans(robot, ends, None)
    certifier = Certifier(robot).prepare()
    with nothing_made(monkeypatch):
        found = plans(robot, ends, certifier)
    for one, other in zip(expected, found, strict=True):
        np.testing.assert_array_equal(one, other)


def test_two_threads_plan_at_a_time(kuka: Robot) -> None:
    ends = allowed_poses(kuka, 2)[:2]
    expected = plans(kuka, ends, None)
    certifiers = [Certifier(kuka).prepare() for _ in range(2)]
    found: list[list[Any]] = []
    threads = [
        threading.Thread(target=lambda own=own: found.extend(plans(kuka, ends, own) for _ in range(3)))
        for own in certifiers
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(found) == 6
    for one in found:
        for value, right in zip(one, expected, strict=True):
            np.testing.assert_array_equal(value, right)


def test_an_approach_that_is_not_wanted_any_more_is_given_up(kuka: Robot) -> None:
    ends = allowed_poses(kuka, 2)[:2]
    with pytest.raises(NotWanted):
        approach(ends[0], ends[1], kuka, wanted=lambda: False)

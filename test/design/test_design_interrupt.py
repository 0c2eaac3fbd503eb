"""Ctrl-C after the search, and the time that is left for the verdict."""

from __future__ import annotations

import pickle
import time
from typing import Any

import pytest

from robot_ident.design import design as module
from robot_ident.design.design import design
from robot_ident.design.multi_start import Run, fallback
from robot_ident.robot import Robot


def test_an_interrupt_during_the_verdict_loses_nothing(kuka: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    deadlines, calls = [], []

    def search(run: Run, setting: Any, *_: object) -> list[Any]:
        deadlines.append(run.deadline)
        return [fallback(pickle.dumps(setting), 0)]

    certify = module.certify

    def interrupted(*given: Any) -> Any:
        calls.append(given)
        if len(calls) == 1:  # the rehearsal, which is slow here
            time.sleep(1.0)
        if len(calls) == 2:
            raise KeyboardInterrupt
        return certify(*given)

    monkeypatch.setattr(module, "search", search)
    monkeypatch.setattr(module, "certify", interrupted)
    deadline = time.monotonic() + 50.0
    found = design(kuka, deadline=deadline)
    assert found.interrupted and found.margins.kept
    assert deadlines[0] < deadline - 2.5, "what the verdict took in the rehearsal is left for it, and more"

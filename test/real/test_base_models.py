"""No option, and a base model at least as good as least squares with offsets by hand."""

from __future__ import annotations

import importlib.util
import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from robot_ident.estimation.identify import identify
from robot_ident.estimation.prediction import predict
from robot_ident.model.model import Model
from robot_ident.recording import Processing


@pytest.fixture(scope="module")
def arms(checkout: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location("real_arms", checkout / "acceptance/real_arms.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["real_arms"] = module
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize(
    "name",
    [
        "EMPS tracking -> pulses",
        "TX40 half 2 -> half 1",
        pytest.param("Panda first half -> rest", marks=pytest.mark.long),
    ],
)
def test_no_option_is_as_good_as_a_plain_fit(name: str, arms: ModuleType, shared_data: Path, tmp_path: Path) -> None:
    case = next(one for one in arms.real_cases(shared_data, tmp_path) if one.name == name)

    def error(model: Model) -> float:
        predicted = predict(model, case.test)
        measured = np.column_stack([np.interp(predicted.t, case.test.t, tau) for tau in case.test.tau.T])
        ends = round(0.1 / float(np.mean(np.diff(predicted.t))))
        rest, whole = (x[ends:-ends] for x in (predicted.torque - measured, measured))
        return float(np.linalg.norm(rest) / np.linalg.norm(whole))

    plain = identify(
        case.train,
        replace(case.robot, base="declared"),
        effects=["torque_offset@*"],
        estimator="ls",
        processing=Processing(periodic=False, low_pass=case.band),
        as_declared=True,
    )
    assert error(identify(case.train, case.robot, as_declared=True)) < 1.02 * error(plain)

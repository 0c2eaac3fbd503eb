"""Runs verbs in this process, as the console script does."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from robot_ident.bags import write_recording
from robot_ident.cli.main import main


@dataclass(frozen=True)
class Outcome:
    """What a verb returned and printed."""

    code: int
    out: str
    err: str

    @property
    def json(self) -> Any:
        """Standard output as one JSON object."""
        return json.loads(self.out)


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str]) -> Callable[..., Outcome]:
    def call(*words: object) -> Outcome:
        capsys.readouterr()
        try:
            code = main([str(word) for word in words])
        except SystemExit as ended:  # argparse, on an option out of its bounds
            if ended.code == 0:
                raise
            code = int(ended.code or 0)
        captured = capsys.readouterr()
        return Outcome(code, captured.out, captured.err)

    return call


@pytest.fixture(scope="session")
def bag(arm: Any, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A rosbag2 folder of 4 periods."""
    path = tmp_path_factory.mktemp("bags") / "four"
    write_recording(path, arm.record(1, periods=4))
    return path


@pytest.fixture(scope="session")
def excitation(arm: Any, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A trajectory within the KUKA's limits."""
    from robot_ident.trajectories.excitation import Excitation
    from robot_ident.trajectories.fourier_series import FourierSeries

    path = tmp_path_factory.mktemp("excitations") / "excitation.yaml"
    series = FourierSeries(0.1, arm.series.q0, 0.6 * arm.series.a, 0.6 * arm.series.b)
    Excitation("kuka_ir361", arm.robot.joints, series, 150.0).write(path)
    return path

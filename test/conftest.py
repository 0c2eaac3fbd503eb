"""Says which robot_ident is tested, and sees to it that `make test` tests the one that was installed."""

from __future__ import annotations

import os
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

import robot_ident
from robot_ident.excitation.fourier import FourierSeries
from robot_ident.model.structure import Structure
from robot_ident.recording import Recording
from robot_ident.robot import Robot, load_robot

CHECKOUT = Path(__file__).resolve().parents[1]
TESTED = Path(robot_ident.__file__).resolve().parent


def pytest_configure() -> None:
    if os.environ.get("ROBOT_IDENT_TEST_INSTALLED") and TESTED.parent == CHECKOUT:
        raise pytest.UsageError(f"the installed package was to be tested, but {TESTED} came first on the path")


def pytest_report_header() -> str:
    return f"robot_ident: {TESTED}"


@pytest.fixture(scope="session")
def checkout() -> Path:
    """Return the folder that holds `setup.py`, whichever robot_ident is tested."""
    return CHECKOUT


@pytest.fixture(scope="session")
def package() -> Path:
    """Return the folder of the robot_ident that is tested."""
    return TESTED


@pytest.fixture(scope="session")
def robots_folder() -> Path:
    """Return the robots of the example-robot-data wheel."""
    for base in map(Path, sys.path):
        folder = base / "cmeel.prefix/share/example-robot-data/robots"
        if folder.is_dir():
            return folder
    return pytest.skip("the example-robot-data wheel is not installed")


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Return the folder of real recordings beside the checkout."""
    folder = CHECKOUT.parent / "shared" / "data"
    if not folder.is_dir():
        pytest.skip("the folder of real recordings is not beside the checkout")
    return folder


@dataclass(frozen=True)
class ExactArm:
    """A KUKA whose torque is the model's to the last digit, on a Fourier series that nobody optimised."""

    robot: Robot
    structure: Structure
    series: FourierSeries

    def record(
        self,
        seed: int = 0,
        *,
        periods: int = 16,
        rate: float = 150.0,
        lead: float = 7.3,
        late: float = 0.0,
        jitter: float = 0.0,
        dropped: float = 0.0,
        noise: float = 1.0,
    ) -> Recording:
        """Record: `lead` s of start-up, then steady periods. late: s by which stamps lag at random; jitter: s of the
        sampling.
        """
        rng = np.random.default_rng(seed)
        t = np.arange(round((lead + self.series.period * periods) * rate)) / rate - lead
        stamps = t + np.minimum(np.abs(rng.normal(size=len(t))) * late, 0.9 / rate)
        if jitter:
            t = np.sort(t + rng.normal(size=len(t)) * jitter)
            stamps = t
        motion = self.series.motion(t)
        blend = np.clip((t + lead) / 5.0, 0.0, 1.0)[:, None] ** 2 if lead else 1.0
        q = motion.q * blend + (1 - blend) * 0.3
        tau = self.structure.columns(motion) @ self.structure.true_values()
        tau = tau + noise * rng.normal(size=tau.shape) * np.sqrt(self.robot.noise.torque_variance)
        q = q + noise * rng.normal(size=q.shape) * np.sqrt(self.robot.noise.position_variance)
        q = np.round(q / self.robot.drives.encoder_step) * self.robot.drives.encoder_step
        keep = rng.random(len(t)) >= dropped
        return Recording(self.robot.joints, stamps[keep] + 1000.0, q[keep], tau[keep], source="arm")


@pytest.fixture(scope="session")
def arm() -> ExactArm:
    """Return a KUKA that is exactly what the model says."""
    robot = load_robot()
    rng = np.random.default_rng(1)
    a, b = 0.25 * rng.normal(size=(2, 3, 5))
    return ExactArm(robot, Structure.build(robot), FourierSeries(0.1, np.array([0.0, 0.2, -0.3]), a, b))

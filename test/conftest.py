"""Says which robot_ident is tested, and sees to it that `make test` tests the one that was installed."""

from __future__ import annotations

import os
import shutil
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import robot_ident
from robot_ident.excitation.fourier import FourierSeries
from robot_ident.model.structure import Structure
from robot_ident.recording import Recording
from robot_ident.robot import Robot, load_robot

if TYPE_CHECKING:
    from robot_ident.excitation.design import DesignResult
    from robot_ident.report.findings import Findings

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


@pytest.fixture(scope="session")
def designed(arm: ExactArm) -> DesignResult:
    """Return a design of the KUKA that nobody searched for: small, within all limits, judged as any other."""
    from robot_ident.excitation.design import DesignResult
    from robot_ident.excitation.excitation import Excitation
    from robot_ident.excitation.limits import certify
    from robot_ident.excitation.target import Target

    series = FourierSeries(0.1, arm.series.q0, 0.4 * arm.series.a, 0.4 * arm.series.b)
    achieved, reproduce = {"periods": 16}, {"robot": "kuka_ir361", "seed": 0, "effects": [], "time_limit": None}
    excitation = Excitation("kuka_ir361", arm.robot.joints, series, 150.0, "d-optimal", achieved, {}, reproduce)
    target, margins = Target.of_robot(arm.robot), certify(excitation, arm.robot)
    det, condition, sigma = target.judge([excitation])
    history = ((0.5, det + 9.0), (2.0, det + 1.0), (7.0, det))
    names = target.structure.names
    return DesignResult((excitation,), det, condition, sigma, names, margins, (margins,), 9.0, history)


@pytest.fixture(scope="session")
def findings(arm: ExactArm, tmp_path_factory: pytest.TempPathFactory) -> Findings:
    """Return what the paper's model and a better one tell of an arm with Stribeck friction at its second joint."""
    from dataclasses import replace

    from robot_ident.bags import read_recording, write_recording
    from robot_ident.estimation.identify import identify
    from robot_ident.excitation.excitation import Excitation
    from robot_ident.provenance import provenance
    from robot_ident.report.findings import gather, read_sources

    folder, rng = tmp_path_factory.mktemp("findings"), np.random.default_rng(5)
    bags = []
    for number, periods in enumerate((8, 8, 1), start=1):
        a, b = 0.25 * rng.normal(size=(2, 3, 5))
        other = replace(arm, series=FourierSeries(0.1, arm.series.q0, a, b))
        plain = other.record(number, periods=periods, lead=0.0)
        speed = other.series.motion(plain.t - 1000.0).dq[:, 1]
        tau = plain.tau.copy()
        tau[:, 1] += 25.0 * np.sign(speed) * np.exp(-np.abs(speed) / 0.15)
        bags.append(str(folder / f"run_{number}.npz"))
        write_recording(bags[-1], replace(plain, tau=tau))
    played = Excitation(arm.robot.name, arm.robot.joints, arm.series, 150.0)
    models = []
    for number, effects in enumerate(([], ["stribeck@joint_2"]), start=1):
        model = identify([read_recording(bag) for bag in bags[:2]], arm.robot, effects=effects)
        models.append((str(folder / f"model_{number}.yaml"), replace(model, provenance=provenance(bags[:2], {}))))
    first = models[0][1]
    return gather(
        models,
        read_sources(bags[:2], first),
        read_sources(bags[2:], first),
        [(str(folder / "excitation.yaml"), played)],
        command="robot_ident report model_1.yaml model_2.yaml",
    )


@pytest.fixture(scope="session")
def chromium() -> str:
    """Return the Chromium of this machine."""
    names = ("chromium", "chromium-browser", "google-chrome")
    found = next((path for name in names if (path := shutil.which(name))), None)
    return found or pytest.skip("no Chromium is installed (apt-get install chromium)")


@pytest.fixture(scope="session")
def browser(chromium: str) -> Iterator[Any]:
    """Return a browser without windows."""
    sync_api = pytest.importorskip("playwright.sync_api")
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox", "--disable-dev-shm-usage"])
        yield browser
        browser.close()


@pytest.fixture
def press_all() -> Callable[[Any], list[str]]:
    """Return a function that presses every button above a page's figures, and returns their titles."""

    def press(page: Any) -> list[str]:
        buttons = page.locator(".modebar-btn")
        titles = [str(one.get_attribute("data-title")) for one in buttons.all()]
        for one in buttons.all():
            one.dispatch_event("click")
        page.wait_for_timeout(300)  # what a click opens or asks for
        assert len(page.context.pages) == 1, "a button has opened another page"
        return titles

    return press

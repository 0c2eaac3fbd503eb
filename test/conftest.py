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
from robot_ident.model.structure import Structure
from robot_ident.recording import Recording
from robot_ident.robot import Robot, load_robot
from robot_ident.trajectories.excitation import Excitation
from robot_ident.trajectories.fourier_series import FourierSeries

if TYPE_CHECKING:
    from robot_ident.design.design import DesignResult
    from robot_ident.workflow.findings import Findings

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
    from robot_ident.design.design import DesignResult
    from robot_ident.design.target import Target
    from robot_ident.limits.certifier import certify
    from robot_ident.trajectories.excitation import Excitation

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
    from robot_ident.provenance import provenance
    from robot_ident.trajectories.excitation import Excitation
    from robot_ident.workflow.findings import gather
    from robot_ident.workflow.inputs import read_sources

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


@pytest.fixture(scope="session")
def kuka() -> Robot:
    return load_robot("kuka_ir361")


@pytest.fixture(scope="session")
def random_excitation(kuka: Robot) -> Callable[..., Excitation]:
    """Return a maker of random trajectories of the KUKA, scaled to reach a share of its joint limits."""

    def make(seed: int, share: float = 0.9) -> Excitation:
        rng = np.random.default_rng(seed)
        q0, a, b = rng.uniform(-0.3, 0.3, 3), rng.normal(size=(3, 5)), rng.normal(size=(3, 5))
        series = FourierSeries(0.1, q0, a, b)
        q, dq, ddq = series.extremes()
        limits = kuka.limits
        used = np.max(
            [
                (q.upper - q0) / (limits.upper - q0),
                (q0 - q.lower) / (q0 - limits.lower),
                dq.largest / limits.velocity,
                ddq.largest / limits.acceleration,
            ],
            axis=0,
        )
        factor = (share / used)[:, None]
        return Excitation("kuka_ir361", kuka.joints, FourierSeries(0.1, q0, a * factor, b * factor), 150.0)

    return make


@pytest.fixture(scope="session")
def gantry(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    """Return a slide that carries a turning arm, with limits for both joints."""
    folder: Path = tmp_path_factory.mktemp("gantry")
    (folder / "gantry.urdf").write_text(GANTRY_URDF, encoding="utf-8")
    (folder / "gantry.yaml").write_text(GANTRY_YAML, encoding="utf-8")
    return load_robot(folder / "gantry.yaml")


@pytest.fixture(scope="session")
def ur10(robots_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Robot:
    """Return a UR10 with the meshes of its links and all limits."""
    path: Path = tmp_path_factory.mktemp("ur10") / "ur10.yaml"
    path.write_text(UR10_YAML, encoding="utf-8")
    return load_robot(path)


UR10_YAML = """schema: robot_ident/robot/1
name: ur10
urdf: package://example-robot-data/robots/ur_description/urdf/ur10_robot.urdf
joints:
  shoulder_pan_joint: {acceleration: 5, position: [-3, 3], torque_variance: 25}
  shoulder_lift_joint: {acceleration: 5, position: [-3, 3], torque_variance: 25}
  elbow_joint: {acceleration: 5, position: [-3, 3], torque_variance: 9}
  wrist_1_joint: {acceleration: 8, position: [-3, 3], torque_variance: 1}
  wrist_2_joint: {acceleration: 8, position: [-3, 3], torque_variance: 1}
  wrist_3_joint: {acceleration: 8, position: [-3, 3], torque_variance: 1}
"""

GANTRY_URDF = """<?xml version="1.0"?>
<robot name="gantry">
  <link name="base"/>
  <joint name="slide" type="prismatic">
    <parent link="base"/><child link="carriage"/><axis xyz="1 0 0"/>
    <limit lower="-0.5" upper="0.5" velocity="0.6" effort="400"/>
  </joint>
  <link name="carriage">
    <inertial><mass value="8"/><inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial>
  </link>
  <joint name="arm" type="revolute">
    <parent link="carriage"/><child link="beam"/><origin xyz="0 0 0.3"/><axis xyz="0 1 0"/>
    <limit lower="-2.5" upper="2.5" velocity="2" effort="60"/>
  </joint>
  <link name="beam">
    <inertial><origin xyz="0.2 0 0.05"/><mass value="3"/>
      <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.05" iyz="0" izz="0.05"/></inertial>
  </link>
  <joint name="tip_joint" type="fixed"><parent link="beam"/><child link="tip"/><origin xyz="0.4 0 0"/></joint>
  <link name="tip"/>
</robot>
"""

GANTRY_YAML = """schema: robot_ident/robot/1
name: gantry
urdf: gantry.urdf
end_effector: tip
joints:
  slide: {acceleration: 2.0, torque_variance: 4.0}
  arm: {acceleration: 6.0, torque_variance: 0.04}
workspace:
  - {kind: half_space, normal: [0, 0, 1], offset: 0.1}
"""

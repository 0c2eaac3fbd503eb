"""Cases of one axis in MuJoCo: a motor on a bench, recorded once, without periods and so without a noise floor."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from mujoco_world.arm import DECIMATE, STEP, Arm, Hidden, Motion, Plan, Servo, differentiated, play
from mujoco_world.effects import KNOWN, Draw, motor
from robot_ident.estimation.identify import identify
from robot_ident.estimation.prediction import measured_for
from robot_ident.recording import Recording
from robot_ident.robot import load_robot
from robot_ident.workflow.steps import find_missing

KINDS = ("torque_ripple", "friction_behind_play", "presliding", "viscous_nonlinear", "nothing")
SECONDS, SETTLED = 30.0, 1.0
NAME = "shaft"

URDF = """<robot name="bench"><link name="base"/><link name="arm"><inertial><origin xyz="{lever} 0 0"/>
<mass value="{mass}"/><inertia ixx="{inertia}" iyy="{inertia}" izz="{inertia}" ixy="0" ixz="0" iyz="0"/></inertial>
</link>
<joint name="shaft" type="continuous"><parent link="base"/><child link="arm"/><origin rpy="1.5707963 0 0"/>
<axis xyz="0 0 1"/><limit effort="100" velocity="50"/></joint></robot>"""


@dataclass(frozen=True)
class OneAxis:
    """hidden: the name of what is, orders: of its ripple; moved: how. named: labels, by the program's defaults; lines:
    orders of ripple among them; tied: sets that are said to be as good.
    """

    hidden: str
    orders: tuple[int, ...]
    moved: str
    named: tuple[str, ...]
    lines: tuple[float, ...]
    tied: tuple[tuple[str, ...], ...]

    @property
    def right(self) -> bool:
        """Whether just what is hidden is named, or a set of a tie; of ripple one of its lines and none that isn't
        there.
        """
        if self.hidden == "torque_ripple":
            there = all(any(abs(line - order) < 0.2 for order in self.orders) for line in self.lines)
            return bool(self.lines) and there and len(self.lines) == len(self.named)
        truth = () if self.hidden == "nothing" else (f"{self.hidden}@{NAME}",)
        return self.named == truth or truth in self.tied

    @property
    def wrong(self) -> bool:
        """Whether anything is named that isn't there."""
        return bool(self.named) and not self.right


def run_case(seed: int, kind: str, folder: Path) -> OneAxis:
    """Draw an axis that hides one kind, record it once, identify and diagnose without an option."""
    rng = np.random.default_rng([seed, *kind.encode()])
    arm = _arm(rng, folder / f"{kind}_{seed}")
    moved = str(rng.choice(["multisine", "moves", "speeds"]))
    motion = _motion(rng, moved)
    orders: tuple[int, ...] = ()
    hidden: list[Hidden] = []
    if kind == "torque_ripple":
        count = int(rng.integers(1, 4))
        orders = tuple(int(order) for order in rng.choice(np.arange(1, 25), count, replace=False))
        hidden = [partial(_cogging, size=arm.coulomb[0] * rng.uniform(0.15, 1.0), order=order,
                          phase=rng.uniform(-np.pi, np.pi)) for order in orders]  # fmt: skip
    elif kind != "nothing":
        draw = Draw(rng, arm, 0, np.array([[motion.q.min(), motion.q.max()]]))
        size = arm.coulomb[0] * rng.uniform(0.05, 0.2) if kind == "viscous_nonlinear" else rng.uniform(0.5, 1.5)
        hidden = [partial(KNOWN[kind](draw), size=size)]
    servo = Servo(rng.uniform(4.0, 12.0), rng.uniform(0.6, 1.0), 0.0)
    q, tau = play(arm, hidden, Plan.of(arm, servo, motion), 1, lead=0)
    rest = round(SETTLED / STEP / DECIMATE)
    q = np.round(q[rest:] / arm.position_noise) * arm.position_noise
    tau = tau[rest:] + rng.normal(size=(len(q), 1)) * arm.torque_noise
    recording = Recording((NAME,), np.arange(len(q)) * STEP * DECIMATE, q, tau, source=f"bench {seed}")
    model = identify([recording], load_robot(arm.urdf.with_name("bench.yaml")))
    found = find_missing(model, [measured_for(model, recording)])
    lines = tuple(one.effect.setting["h"] for one in found.missing if one.effect.name.startswith("torque_ripple"))
    named = tuple(one.label for one in found.missing)
    return OneAxis(kind, orders, moved, named, lines, found.tied_sets)


def _cogging(spec: Any, size: float, order: int, phase: float) -> None:
    motor(spec, NAME, cogging=[size, order, phase])


def _arm(rng: np.random.Generator, folder: Path) -> Arm:
    """Return a balanced or an unbalanced mass on a motor with a rotor, friction and an encoder of 12 to 16 bit."""
    folder.mkdir(parents=True, exist_ok=True)
    lever = float(rng.choice([0.0, rng.uniform(0.02, 0.15)]))
    urdf = folder / "bench.urdf"
    urdf.write_text(URDF.format(lever=lever, mass=rng.uniform(0.3, 2.0), inertia=rng.uniform(0.002, 0.02)))
    (folder / "bench.yaml").write_text("schema: robot_ident/robot/1\nname: bench\nurdf: bench.urdf\n")
    coulomb = float(np.exp(rng.uniform(np.log(0.1), 0.0)))
    return Arm(
        "bench", urdf, (NAME,), np.array([coulomb]), np.array([coulomb * rng.uniform(0.05, 0.4)]),
        np.array([rng.uniform(0.001, 0.02)]), np.array([coulomb * rng.uniform(0.01, 0.05)]),
        float(2.0 * np.pi / rng.choice([4096, 16384, 65536])),
    )  # fmt: skip


def _motion(rng: np.random.Generator, moved: str) -> Motion:
    """Return half a minute of many sines, of moves to and fro, or of steady speeds."""
    count = round(SECONDS / STEP / DECIMATE) * DECIMATE
    t = np.arange(count) * STEP
    if moved == "multisine":
        f = np.arange(1, 40) / SECONDS * rng.choice([1, 2])
        sizes, phases = rng.normal(size=len(f)) / f**1.2, rng.uniform(0.0, 2.0 * np.pi, len(f))
        q = np.sin(2.0 * np.pi * np.outer(t, f) + phases) @ sizes
        return differentiated((q * rng.uniform(1.0, 6.0) / np.abs(q).max())[:, None], STEP)
    if moved == "moves":
        speeds = rng.uniform(0.2, 1.0, 12) * np.resize([1.0, -1.0], 12) * rng.uniform(1.0, 6.0)
    else:
        speeds = np.resize([1.0, 0.5, -1.0, -0.5, 0.1, -0.1, 0.3, -0.3], 16) * rng.uniform(2.0, 6.0)
    window = np.hanning(400)
    speed = np.convolve(np.repeat(speeds, count // len(speeds) + 1)[:count], window / window.sum(), "same")
    q = np.cumsum(speed) * STEP
    return differentiated((q - np.linspace(0.0, q[-1] - q[0], count, endpoint=False))[:, None], STEP)

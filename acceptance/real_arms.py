"""Public recordings of real arms, each with what it is fitted to and the motion that judges it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from robot_ident.recording import Recording
from robot_ident.robot import Robot, load_robot
from robot_ident.signals.motion import Array


@dataclass(frozen=True)
class Case:
    """One arm: recordings that are fitted, the one that judges, and the band [Hz] in which its error counts."""

    name: str
    robot: Robot
    train: tuple[Recording, ...]
    test: Recording
    band: float = 10.0


def real_cases(data: Path, scratch: Path) -> list[Case]:
    """Return the cases of `docs/real_robots.md`; `data` holds the recordings, robots are written below `scratch`."""
    makers = (_emps, _tx40, _kr300, _panda, _lwr)
    return [case for made in makers for case in made(data, scratch)]


def _robot(scratch: Path, name: str, urdf: Path) -> Robot:
    folder = scratch / name
    folder.mkdir(parents=True, exist_ok=True)
    (folder / urdf.name).write_text(urdf.read_text(encoding="utf-8"), encoding="utf-8")
    path = folder / "robot.yaml"
    path.write_text(f"schema: robot_ident/robot/1\nname: {name}\nurdf: {urdf.name}\n", encoding="utf-8")
    return load_robot(path)


def _part(robot: Robot, t: Array, q: Array, tau: Array, source: str) -> Recording:
    return Recording(robot.joints, t, q, tau, source=source)


def _emps(data: Path, scratch: Path) -> list[Case]:
    robot = _robot(scratch, "emps", Path(__file__).parent.parent / "examples/emps/emps.urdf")
    z = np.load(data / "emps/data.npz")
    half = len(z["t"]) // 2

    def part(rows: slice, source: str, prefix: str = "") -> Recording:
        q, tau = (z[prefix + key][rows].reshape(-1, 1) for key in ("q", "tau"))
        return _part(robot, z[prefix + "t"][rows], q, tau, source)

    whole = part(slice(None), "tracking")
    return [
        Case("EMPS tracking -> pulses", robot, (whole,), part(slice(None), "pulses", "val_"), 40.0),
        Case("EMPS half 1 -> half 2", robot, (part(slice(half), "half 1"),), part(slice(half, None), "half 2"), 40.0),
    ]


def _tx40(data: Path, scratch: Path) -> list[Case]:
    robot = _robot(scratch, "staubli_tx40", data / "staubli_tx40/tx40_mdh_modified.urdf")
    z = np.load(data / "staubli_tx40/data.npz")
    moving = slice(300, 38500, 5)  # before and after it stands; 1 kHz
    t, q, tau = (z[key][moving] for key in ("t", "q", "tau"))
    half = len(t) // 2
    parts = [
        _part(robot, t[rows], q[rows], tau[rows], f"half {number}")
        for number, rows in ((1, slice(half)), (2, slice(half, None)))
    ]
    return [
        Case("TX40 half 1 -> half 2", robot, (parts[0],), parts[1]),
        Case("TX40 half 2 -> half 1", robot, (parts[1],), parts[0]),
    ]


def _kr300(data: Path, scratch: Path) -> list[Case]:
    robot = _robot(scratch, "kuka_kr300", data / "kuka_kr300/kr300_dh.urdf")
    z = np.load(data / "kuka_kr300/data.npz")
    a, b, c = (
        _part(
            robot,
            z[f"{key}__t"],
            z[f"{key}__q_motor_side"] + z["q_home"],
            z[f"{key}__tau_motor"] * z["gear_ratio"],
            key,
        )
        for key in "ABC"
    )
    return [
        Case("KR300 A -> B", robot, (a,), b),
        Case("KR300 A -> C", robot, (a,), c),
        Case("KR300 A, B -> C", robot, (a, b), c),
    ]


def _panda(data: Path, scratch: Path) -> list[Case]:
    robot = _robot(scratch, "franka_panda", data / "franka_panda/panda.urdf")
    z = np.load(data / "franka_panda/data.npz")
    first = z["t"] - z["t"][0] < 10.5
    train, test = (
        _part(robot, z["t"][rows], z["q"][rows], z["tau"][rows], source)
        for rows, source in ((first, "first 10.5 s"), (~first, "last 10.5 s"))
    )
    return [Case("Panda first half -> rest", robot, (train,), test)]


def _lwr(data: Path, scratch: Path) -> list[Case]:
    robot = _robot(scratch, "kuka_lwr4", data / "kuka_lwr4/kuka_lwr4.urdf")
    runs = []
    for number in (1, 2, 3):
        z = np.load(data / f"kuka_lwr4/run{number}.npz")
        runs.append(_part(robot, z["t"], z["q"], z["tau"], f"run {number}"))
    return [Case("LWR runs 1, 3 -> run 2", robot, (runs[0], runs[2]), runs[1], 8.0)]

"""The demo's experiment: excitations designed, then played and recorded by real nodes over real DDS."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from robot_ident.cli.output import Progress, tell

if TYPE_CHECKING:
    from robot_ident.cli.node_processes import NodeProcess
    from robot_ident.excitation.design import Progress as DesignProgress
    from robot_ident.robot import Robot

TRAJECTORIES = 2
_PAPER = -48.63  # log10 of the paper's determinant
_SPEED = 2.0  # times real time, at most
_COARSE = {"rate": 50.0, "ahead": 0.04}  # every step of time wakes every node, which does all that is due within it
_PATIENCE = 300.0  # s of real time for which a motion may not move on, its start included


@dataclass(frozen=True)
class Run:
    """A motion that is played and recorded."""

    name: str
    file: Path
    duration: float
    periods: int

    @property
    def bag(self) -> Path:
        """The recording."""
        return self.file.parent / self.name


def design_motions(robot: Robot, folder: Path, *, periods: int, seconds: float, seed: int) -> list[Run]:
    """Design two excitations and draw a validation motion."""
    from robot_ident.excitation.design import design
    from robot_ident.excitation.playback import Playback
    from robot_ident.excitation.validation import validation_motion

    runs = []
    for k in range(1, TRAJECTORIES + 1):
        limit = seconds / TRAJECTORIES
        tell(f"[1/5] Designing excitation {k} of {TRAJECTORIES} (d-optimality, {limit:.0f} s)")
        for more in (1, 2, 4):  # a loaded machine gets more time
            with Progress("design", more * limit) as bar:
                found = design(
                    robot, seed=seed + k - 1, time_limit=more * limit, progress=partial(_show, bar, more * limit)
                )
            if found.log10_det_covariance < _PAPER:
                break
        file = folder / f"excitation_{k}.yaml"
        found.excitation.write(file)
        tell(
            f"      det of the covariance 10^{found.log10_det_covariance:.2f}, condition number"
            f" {found.condition_number:.2f}; the paper's: 10^-48.63, 5.94; all limits certified"
        )
        runs.append(Run(f"run_{k}", file, Playback(found.excitation, robot, periods).duration, periods))
    motion = validation_motion(robot, seed=seed)
    motion.write(folder / "validation.yaml")
    runs.append(Run("validation", folder / "validation.yaml", motion.duration, 1))
    return runs


def _show(bar: Progress, limit: float, state: DesignProgress) -> None:
    bar.reach(min(limit, state.seconds), f"det 10^{state.log10_det_covariance:.2f}")


def record(runs: list[Run], folder: Path, *, seed: int, hidden: Sequence[str]) -> None:
    """Play every motion on a simulated robot of its own, all at the same time, each in its own DDS domain.

    A loaded machine only makes it longer: a failure is a node that ends or a motion that stands still.
    """
    from robot_ident.bags import BagGrowth
    from robot_ident.cli.node_processes import free_domains, wait_for

    longest = max(run.duration for run in runs)
    tell(
        f"[2/5] Playing {len(runs)} motions of up to {longest:.0f} s on {len(runs)} simulated robots side by side,"
        f" {4 * len(runs)} node processes over DDS, in simulated time:"
        f" up to {_SPEED:g} times real time, as fast as this machine can"
    )
    commanded = {run.name: BagGrowth(run.bag.absolute(), "/joint_command") for run in runs}
    reached = dict.fromkeys(commanded, 0.0)
    crews: dict[str, list[NodeProcess]] = {}
    try:
        for k, (motion, domain) in enumerate(zip(runs, free_domains(len(runs)), strict=True)):
            crews[motion.name] = _crew(motion, domain, folder, seed + k, hidden)
        others = [node for crew in crews.values() for node in crew[:-1]]

        def progress() -> dict[str, float]:
            playing = {name: commanded[name].seconds() for name, crew in crews.items() if crew[-1].running}
            reached.update(playing)
            return {f"the motion {name}": seconds for name, seconds in playing.items()}

        with Progress("playing", longest) as bar:
            wait_for(
                lambda: not any(crew[-1].running for crew in crews.values()),
                others,
                progress,
                _PATIENCE,
                lambda: bar.reach(min(longest, *reached.values())),
            )
        for crew in crews.values():
            for node in reversed(crew):
                node.end()
    finally:
        for crew in crews.values():
            for node in crew:
                node.kill()


def _crew(motion: Run, domain: int, folder: Path, seed: int, hidden: Sequence[str]) -> list[NodeProcess]:
    """Start robot, recorder and publisher for one motion; the publisher is the last."""
    from robot_ident.cli.node_processes import NodeProcess

    logs = folder / "logs" / motion.name
    logs.mkdir(parents=True)
    simulated = {"use_sim_time": True}  # time that waits for the nodes: a loaded machine slows it and disturbs nothing
    crew = [
        NodeProcess("simulated_clock", {"speed": _SPEED, "patience": 30.0, **_COARSE}, domain, logs),
        NodeProcess(
            "simulated_kuka",
            {"seed": seed, "delay": 0.6, "effects": list(hidden) or [""], **simulated},
            domain,
            logs,
        ),
        NodeProcess("recorder", {"output": motion.bag.absolute(), **simulated}, domain, logs),
    ]
    play = {"trajectory": motion.file.absolute(), "periods": motion.periods, "autostart": True, "exit_when_done": True}
    play |= {"tracking_error": [10.0], "state_wait": _PATIENCE, "state_timeout": 10.0, **simulated}
    return [*crew, NodeProcess("trajectory_publisher", play, domain, logs)]

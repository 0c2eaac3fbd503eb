"""`robot_ident demo`: the whole story, with the real nodes in separate processes over real DDS."""

from __future__ import annotations

import argparse
import importlib.util
import os
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from robot_ident.cli.output import Progress, add_json, print_json, say, table, tell
from robot_ident.errors import InputError

if TYPE_CHECKING:
    from robot_ident.cli.node_processes import NodeProcess
    from robot_ident.estimation.validate import Validation
    from robot_ident.model.model import Model
    from robot_ident.robot import Robot

_TRAJECTORIES = 2
_SPEED = 2.0  # times real time, at most
_SLACK = 300.0  # s beyond the motion that discovery, approach and a loaded machine may take


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's options."""
    parser.add_argument(
        "--periods", type=int, default=6, help="steady periods of each trajectory (default %(default)s)"
    )
    parser.add_argument("--design-time", type=float, default=25.0, metavar="S", help="to optimise the excitations")
    parser.add_argument("--seed", type=int, default=0, help="of design and noise (default %(default)s)")
    parser.add_argument("--folder", default="robot_ident_demo", help="where everything is kept (default ./%(default)s)")
    parser.add_argument("--force", action="store_true", help="replace the folder of an earlier demo")
    add_json(parser)


@dataclass(frozen=True)
class _Run:
    """A motion that is played and recorded."""

    name: str
    file: Path
    duration: float
    periods: int

    @property
    def bag(self) -> Path:
        """The recording."""
        return self.file.parent / self.name


def run(args: argparse.Namespace) -> int:
    """Design, excite, record, identify, validate."""
    from robot_ident.robot import load_robot

    started = time.monotonic()
    if args.periods < 2:
        raise InputError(f"--periods {args.periods}: at least 2 are needed to tell the noise")
    folder = _folder(Path(args.folder), args.force)
    robot = load_robot()
    tell(f"A simulated {robot.name} is excited, recorded, identified and validated; everything is kept in {folder}/")
    runs = _motions(robot, folder, args)
    _record(runs, folder, args.seed)
    model, validation = _identify(robot, runs, folder)
    seconds = time.monotonic() - started
    if args.json:
        print_json(_to_dict(model, validation, runs, seconds))
        return 0
    _print(model, validation)
    text = f"\nKept in {folder}/: excitations, recordings (rosbag2 MCAP), model.yaml, logs of the nodes; {seconds:.0f} s in all."
    say(text)
    return 0


def _folder(folder: Path, force: bool) -> Path:
    import shutil

    if folder.exists() and force and (folder / ".robot_ident_demo").exists():
        shutil.rmtree(folder)
    if folder.exists() and not force and (folder / ".robot_ident_demo").exists():
        number = next(k for k in range(2, 10_000) if not Path(f"{folder}_{k}").exists())
        folder = Path(f"{folder}_{number}")
    try:
        folder.mkdir(parents=True)
    except OSError as error:
        raise InputError(f"--folder {folder}: can't be made ({error.strerror})") from error
    (folder / ".robot_ident_demo").write_text("made by robot_ident demo\n")
    return folder


def _motions(robot: Robot, folder: Path, args: argparse.Namespace) -> list[_Run]:
    """Design two excitations and draw a validation motion."""
    from robot_ident.excitation.design import design
    from robot_ident.excitation.playback import Playback
    from robot_ident.excitation.validation import validation_motion

    runs = []
    for k in range(1, _TRAJECTORIES + 1):
        limit = args.design_time / _TRAJECTORIES
        tell(f"[1/4] Designing excitation {k} of {_TRAJECTORIES} (d-optimality, {limit:.0f} s)")
        with Progress("design", limit) as bar:
            found = design(
                robot,
                seed=args.seed + k - 1,
                time_limit=limit,
                progress=lambda state, bar=bar: bar.reach(
                    min(limit, state.seconds), f"det 10^{state.log10_det_covariance:.2f}"
                ),
            )
        file = folder / f"excitation_{k}.yaml"
        found.excitation.write(file)
        tell(
            f"      det of the covariance 10^{found.log10_det_covariance:.2f}, condition number"
            f" {found.condition_number:.2f}; the paper's: 10^-48.63, 5.94; all limits certified"
        )
        runs.append(_Run(f"run_{k}", file, Playback(found.excitation, robot, args.periods).duration, args.periods))
    motion = validation_motion(robot, seed=args.seed)
    motion.write(folder / "validation.yaml")
    runs.append(_Run("validation", folder / "validation.yaml", motion.duration, 1))
    return runs


def _record(runs: list[_Run], folder: Path, seed: int) -> None:
    """Play every motion on a simulated robot of its own, all at the same time, each in its own DDS domain."""
    if importlib.util.find_spec("rclpy") is None:
        raise InputError("the demo needs ROS 2; pip install 'robot_ident[ros]'")
    from robot_ident.cli.node_processes import wait_for

    longest = max(run.duration for run in runs)
    tell(
        f"[2/4] Playing {len(runs)} motions of up to {longest:.0f} s on {len(runs)} simulated robots side by side,"
        f" {4 * len(runs)} node processes over DDS, in simulated time: up to {_SPEED:g} times real time, as fast as this machine can"
    )
    crews: list[list[NodeProcess]] = []
    try:
        for k, motion in enumerate(runs):
            crews.append(_crew(motion, k, folder, seed))
        publishers = [crew[-1] for crew in crews]
        others = [node for crew in crews for node in crew[:-1]]
        begun = time.monotonic()
        with Progress("playing", longest) as bar:
            wait_for(
                lambda: not any(node.running for node in publishers),
                others,
                longest + _SLACK,
                lambda: bar.reach(min(longest, time.monotonic() - begun)),
            )
        for crew in crews:
            for node in reversed(crew):
                node.end()
    finally:
        for crew in crews:
            for node in crew:
                node.kill()


def _crew(motion: _Run, index: int, folder: Path, seed: int) -> list[NodeProcess]:
    """Start robot, recorder and publisher for one motion; the publisher is the last."""
    from robot_ident.cli.node_processes import NodeProcess

    domain = 1 + (3 * os.getpid() + index) % 100
    logs = folder / "logs" / motion.name
    logs.mkdir(parents=True)
    simulated = {"use_sim_time": True}  # time that waits for the nodes: a loaded machine slows it and disturbs nothing
    crew = [
        NodeProcess("simulated_clock", {"speed": _SPEED}, domain, logs),
        NodeProcess("simulated_kuka", {"seed": seed + index, "delay": 0.6, **simulated}, domain, logs),
        NodeProcess("recorder", {"output": motion.bag.absolute(), **simulated}, domain, logs),
    ]
    play = {"trajectory": motion.file.absolute(), "periods": motion.periods, "autostart": True, "exit_when_done": True}
    play |= {"tracking_error": [10.0], "state_wait": 60.0, "state_timeout": 2.0, **simulated}
    return [*crew, NodeProcess("trajectory_publisher", play, domain, logs)]


def _identify(robot: Robot, runs: list[_Run], folder: Path) -> tuple[Model, Validation]:
    from dataclasses import replace

    from robot_ident.bags import read_recording
    from robot_ident.cli.provenance import provenance
    from robot_ident.estimation.identify import identify
    from robot_ident.estimation.validate import validate
    from robot_ident.model.model_file import write_model

    tell("[3/4] Identifying from the recordings, by weighted least squares")
    bags = [str(motion.bag) for motion in runs[:-1]]
    model = identify([read_recording(bag) for bag in bags], robot)
    model = replace(model, provenance=provenance(bags, {"demo": True}))
    write_model(model, folder / "model.yaml")
    tell("[4/4] Validating on 20 points with full stops, a motion that the model has not seen")
    return model, validate(model, read_recording(runs[-1].bag))


def _print(model: Model, validation: Validation) -> None:
    from robot_ident.cli.identify import fit_table

    truth = model.structure.true_values()
    rows = [
        (p.name, f"{t:.3f}", f"{v:.3f}", f"{s:.3f}", f"{(v - t) / s:+.2f}", p.unit, p.meaning)
        for p, t, v, s in zip(model.structure.parameters, truth, model.values, model.std, strict=True)
    ]
    say(table(("parameter", "true", "estimate", "sigma", "error/sigma", "unit", "meaning"), rows))
    say(
        f"\nresidual of {_TRAJECTORIES} recordings of {model.noise.periods} averaged periods, beside the noise measured without a model"
    )
    say(fit_table(model.robot, model.residual))
    say("\nvalidation on 20 points (moving samples, 10 Hz low pass), beside the noise of one pass")
    say(fit_table(model.robot, validation.residual))


def _to_dict(model: Model, validation: Validation, runs: list[_Run], seconds: float) -> dict[str, Any]:
    truth = dict(zip(model.structure.names, model.structure.true_values().tolist(), strict=True))
    return {
        "schema": "robot_ident/demo/1",
        "seconds": seconds,
        "folder": str(runs[0].file.parent),
        "bags": [str(motion.bag) for motion in runs],
        "true_values": truth,
        "model": model.to_dict(),
        "validation": validation.to_dict(),
    }

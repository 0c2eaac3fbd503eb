"""`robot_ident demo`: an end-to-end example on a simulated KUKA with hidden effects.

Excitations are designed, then played and recorded by real nodes, each a process of its own, over real DDS.
"""

from __future__ import annotations

import argparse
import fcntl
import importlib.util
import itertools
import os
import shlex
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, TextIO

from robot_ident.bags import BagGrowth, read_recording
from robot_ident.cli.output import Progress, print_json, say, table, tell
from robot_ident.cli.steps import bar
from robot_ident.design.design import Progress as DesignProgress
from robot_ident.design.design import design
from robot_ident.diagnosis.staircase import Step
from robot_ident.errors import InputError, RobotIdentError
from robot_ident.estimation.identify import estimate
from robot_ident.estimation.validation import validate
from robot_ident.model.model import Model
from robot_ident.model.model_file import read_model, write_model
from robot_ident.model.structure import Structure
from robot_ident.paper.printed import SPRING_CONDITION, SPRING_LOG10_DET
from robot_ident.parallel import PARENT
from robot_ident.planning.blends import Playback
from robot_ident.planning.validation_motion import validation_motion
from robot_ident.provenance import provenance
from robot_ident.recording.process import process
from robot_ident.report.sections import write_report
from robot_ident.robot import Robot, load_robot
from robot_ident.signals.motion import Array
from robot_ident.testbed.phenomena import plant_physics
from robot_ident.testbed.simulation import Play
from robot_ident.trajectories.excitation import Excitation
from robot_ident.workflow.findings import Findings, gather
from robot_ident.workflow.inputs import read_excitations, read_inputs, read_sources
from robot_ident.workflow.steps import Additions, add_until_adequate, find_missing

ROBOT = "kuka_ir361_spring"
# What the paper's robot of section V has here and its 25 parameters (spring and torque offsets included) lack: a ripple
# of the motor, losses that grow with the load of the gear, friction that rises at low speed. Sizes by which every
# joint's residual begins at two to three times its noise (in the paper's figure 4: 1.5 to 1.9 times).
HIDDEN = (
    "torque_ripple@joint_1:torque_ripple=18",
    "load_friction@joint_2:load_friction=0.24",
    "stribeck@joint_3:stribeck=44,speed=0.1",
)
_QUIET = 1e-6  # of the noise's variance: as good as none, and the weights keep their ratios


def run(args: argparse.Namespace) -> None:
    """Design, excite, record, identify, diagnose, add, validate."""
    started = time.monotonic()
    hidden = HIDDEN if args.hidden is None else args.hidden
    if importlib.util.find_spec("rclpy") is None:
        raise InputError("the demo needs ROS 2; install it with pip install '.[ros]' in the checkout")
    folder = _folder(Path(args.folder), args.force)
    robot = load_robot(ROBOT)
    tell(f"Simulated {robot.name}: designed, recorded, identified and diagnosed; all files are in {folder}/")
    runs = design_motions(robot, folder, periods=args.periods, seconds=args.design_time, seed=args.seed)
    record(runs, folder, seed=args.seed, hidden=hidden)
    added = _identify(robot, runs, folder)
    page = folder / "report.html"
    found = _report(runs, len(added.steps), folder, page)
    truth = _without_noise(found.last.model, runs, hidden)
    seconds = time.monotonic() - started
    if args.json:
        print_json({**_to_dict(found, added, truth, runs, seconds), "report": str(page)})
        return
    say(_summary(found, added, truth))
    say(f"\nOpen {page} in a browser. Excitations, recordings (rosbag2 MCAP), models and logs are beside it.")
    say(f"{seconds:.0f} s in all.")


def _folder(folder: Path, force: bool) -> Path:
    """Make the folder; that of an earlier demo is kept beside the new one, or replaced on request."""
    mark = ".robot_ident_demo"
    if (folder / mark).exists():
        if force:
            shutil.rmtree(folder)
        else:
            folder = next(p for k in range(2, 10_000) if not (p := Path(f"{folder}_{k}")).exists())
    try:
        folder.mkdir(parents=True)
    except OSError as error:
        raise InputError(f"--folder {folder}: can't be made ({error.strerror})") from error
    (folder / mark).write_text("made by robot_ident demo\n")
    return folder


def _identify(robot: Robot, runs: list[Run], folder: Path) -> Additions:
    """Identify the model of section V, add what `diagnose --add-until-adequate` names, write every model of the way."""
    tell("[3/5] Identifying the paper's 25 parameters (weighted least squares)")
    *fitted, validation = [str(motion.bag) for motion in runs]
    model = estimate([process(read_recording(bag), robot) for bag in fitted], Structure.build(robot))
    origin = provenance(fitted, {"demo": True})
    write_model(replace(model, provenance=origin), folder / "model_1.yaml")
    tell(
        "[4/5] Diagnosing: is the residual noise? If not, selecting the missing effects and adding one after the other"
    )
    inputs = read_inputs([str(folder / "model_1.yaml"), *fitted], [validation], None)
    first = find_missing(inputs.models[0], inputs.measurements, inputs.validation)
    added = add_until_adequate(first, inputs, bar)
    for number, step in enumerate(added.steps[1:], 2):
        write_model(replace(step.model, provenance=origin), folder / f"model_{number}.yaml")
    return added


def _report(runs: list[Run], count: int, folder: Path, page: Path) -> Findings:
    """Compare the models with the recordings, from what is on disk, and write the report."""
    tell("[5/5] Validating on 20 points with full stops, a motion that enters no fit; writing the report")
    paths = [str(folder / f"model_{number}.yaml") for number in range(1, count + 1)]
    models = [(path, read_model(path)) for path in paths]
    *fitted, validation = [str(motion.bag) for motion in runs]
    played = [str(motion.file) for motion in runs[:-1]]
    words = ["robot_ident", "report", *paths, "--bag", *fitted, "--validation", validation]
    words += [word for file in played for word in ("--trajectory", file)]
    found = gather(
        models,
        read_sources(fitted, models[0][1]),
        read_sources([validation], models[0][1]),
        read_excitations(played, []),
        command=shlex.join([*words, "-o", str(page)]),
    )
    write_report(page, found)
    return found


def _without_noise(model: Model, runs: list[Run], hidden: Sequence[str]) -> Array:
    """Return the parameters [p] that the same robot gives without noise: the truth in the model's own form.

    The true values themselves, but where the model's formula is not the simulated one (Stribeck friction) and where an
    effect merges with another parameter (the spring's sine with gravity).
    """
    physics = plant_physics(model.robot, list(hidden))
    plays = [Play.of(model.robot, physics, Excitation.read(motion.file).series) for motion in runs[:-1]]
    quiet = [process(play.record(2, noise=_QUIET), model.robot) for play in plays]
    return estimate(quiet, model.structure).linear


def _summary(found: Findings, added: Additions, truth: Array) -> str:
    """Return the excess over noise from step to step, and what it comes to in words."""
    joints, steps = found.robot.joints, found.steps
    explained = {finding.label: finding.explained for said in added.said for finding in said.missing}
    rows: list[tuple[object, ...]] = []
    for step in steps:
        name = " ".join(f"+ {label}" for label in step.added) or "paper's model"
        share = " ".join(f"{100 * explained[label]:.0f} %" for label in step.added if label in explained)
        rows.append((name, share, *(_pair(step, joint, "excess") for joint in joints)))
    rows.append(("noise", "", *(_pair(steps[0], joint, "noise") for joint in joints)))
    title = "Excess over noise [Nm rms], fitted recordings / validation motion:"
    levels = [steps[0].training[joint] for joint in joints]
    ratios = ", ".join(f"{level.rms / (level.noise or level.rms):.1f}" for level in levels)
    lines = ["", title, table(("model", "explains", *joints), rows), ""]
    lines.append(f"Paper's model: residual / noise = {ratios}. {_ending(found, added)}")
    z = abs(found.last.model.linear - truth) / found.last.model.std[: len(truth)]
    lines.append(
        f"{int((z < 2).sum())} of {len(z)} parameters are within 2 sigma of their values without noise;"
        f" the farthest is off by {z.max():.1f} sigma."
    )
    return "\n".join(lines)


def _ending(found: Findings, added: Additions) -> str:
    """Return the last verdict in a sentence: with the effects selected where there are any."""
    names = [label for step in found.steps for label in step.added]
    last = f"{added.last.in_words}{'; ' + added.stopped if added.stopped else ''}."
    if not names:
        return f"diagnose: {last}"
    return f"With the {len(names)} effects that diagnose selected, the model is {last}"


def _pair(step: Step, joint: str, figure: str) -> str:
    """Return a level's `excess` or `noise` at a joint, on fitted recordings and on the validation."""
    values = [getattr(levels[joint], figure) for levels in (step.training, step.validation)]
    return " / ".join("-" if value is None else f"{value:.1f}" for value in values)


def _to_dict(found: Findings, added: Additions, truth: Array, runs: list[Run], seconds: float) -> dict[str, Any]:
    models = [step.model for step in found.steps]
    return {
        "schema": "robot_ident/demo/1",
        "seconds": seconds,
        "folder": str(runs[0].file.parent),
        "bags": [str(motion.bag) for motion in runs],
        "true_values": dict(zip(models[-1].structure.names, truth.tolist(), strict=True)),
        "model": models[-1].to_dict(),
        "models": [model.to_dict() for model in models],
        "diagnosis": added.said[0].to_dict(),
        "validation": validate(models[-1], found.validation[0].recording).to_dict(),
    }


TRAJECTORIES = 2
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
    runs = []
    for k in range(1, TRAJECTORIES + 1):
        limit = seconds / TRAJECTORIES
        tell(f"[1/5] Designing excitation {k} of {TRAJECTORIES} (d-optimality, {limit:.0f} s)")
        for more in (1, 2, 4):  # a loaded machine gets more time
            with Progress("design", more * limit) as bar:
                found = design(
                    robot, seed=seed + k - 1, time_limit=more * limit, progress=partial(_show, bar, more * limit)
                )
            if found.log10_det_covariance < SPRING_LOG10_DET["d-optimal"]:
                break
        file = folder / f"excitation_{k}.yaml"
        found.excitation.write(file)
        tell(
            f"      det of the covariance 10^{found.log10_det_covariance:.2f}, condition number"
            f" {found.condition_number:.1f}; the paper's: 10^{SPRING_LOG10_DET['d-optimal']:.2f},"
            f" {SPRING_CONDITION['d-optimal']:.1f}; all limits certified"
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

    logs = folder / "logs" / motion.name
    logs.mkdir(parents=True)
    simulated = {"use_sim_time": True}  # time that waits for the nodes: a loaded machine slows it and disturbs nothing
    crew = [
        NodeProcess("simulated_clock", {"speed": _SPEED, "patience": 30.0, **_COARSE}, domain, logs),
        NodeProcess(
            "simulated_kuka",
            {"robot": ROBOT, "seed": seed, "delay": 0.6, "effects": list(hidden) or [""], **simulated},
            domain,
            logs,
        ),
        NodeProcess("recorder", {"output": motion.bag.absolute(), **simulated}, domain, logs),
    ]
    play = {"trajectory": motion.file.absolute(), "periods": motion.periods, "autostart": True, "exit_when_done": True}
    play |= {"robot": ROBOT, "tracking_error": [10.0], "state_wait": _PATIENCE, "state_timeout": 10.0, **simulated}
    return [*crew, NodeProcess("trajectory_publisher", play, domain, logs)]


_END = 60.0  # s that a node has to end after SIGINT, on a machine that hardly lets it run
_DOMAINS = 100
_PARTICIPANTS = 20
_LOCKS: list[TextIO] = []
_LOOK = 0.1  # s between two looks at what is waited for
_LONGEST_LOOK = 1.0  # s; after more than that this process has stood still itself


class NodeProcess:
    """A node, started with parameters in a DDS domain of its own; its output goes to a log file."""

    def __init__(self, node: str, parameters: dict[str, Any], domain: int, folder: Path) -> None:
        """Start the node."""
        self.node = node
        self.log = folder / f"{node}.log"
        arguments = [word for key, value in parameters.items() for word in ("-p", f"{key}:={_text(value)}")]
        environment = {
            **os.environ,
            "ROS_DOMAIN_ID": str(domain),
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
            "ROS_LOG_DIR": str(folder / "ros"),
            "OMP_NUM_THREADS": "1",
            PARENT: str(os.getpid()),
        }
        with self.log.open("wb") as log:
            self._process = subprocess.Popen(
                [sys.executable, "-m", f"robot_ident.nodes.{node}", "--ros-args", *arguments],
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                env=environment,
                start_new_session=True,
            )

    @property
    def running(self) -> bool:
        """Whether it is running."""
        return self._process.poll() is None

    def end(self) -> None:
        """Ask it to end (SIGINT) and wait; RobotIdentError when it failed."""
        if self.running:
            self._process.send_signal(signal.SIGINT)
        try:
            code = self._process.wait(_END)
        except subprocess.TimeoutExpired:
            self.kill()
            raise RobotIdentError(f"node {self.node} did not end within {_END:g} s; its log: {self.log}") from None
        if code != 0:
            raise RobotIdentError(f"node {self.node} ended with code {code}: {self._last_line()} (its log: {self.log})")

    def kill(self) -> None:
        """End it by force."""
        if self.running:
            os.killpg(self._process.pid, signal.SIGKILL)
            self._process.wait()

    def _last_line(self) -> str:
        lines = [line for line in self.log.read_text(errors="replace").splitlines() if line.strip()]
        return lines[-1] if lines else "it said nothing"


def free_domains(count: int) -> list[int]:
    """Return so many DDS domains in which nobody runs on this machine; RobotIdentError when there are not enough.

    Participant k of domain d listens on UDP port 7410 + 250 d + 2 k (RTPS 2.5, 9.6.2.3): where none of these is taken
    there is none. Domains up to 100 keep clear of the ports that the system hands out itself. They are this process's
    own until it ends: another that looks before any node has begun leaves them alone.
    """
    offset = os.getpid()
    in_turn = (1 + (offset + k) % _DOMAINS for k in range(_DOMAINS))
    locks = ((domain, lock) for domain in in_turn if _free(domain) and (lock := _lock(domain)) is not None)
    found = list(itertools.islice(locks, count))
    domains = [domain for domain, _ in found]
    if len(domains) < count:
        for _, lock in found:
            lock.close()
        raise RobotIdentError(
            f"{count} DDS domains are needed that no node uses; {len(domains)} of {_DOMAINS} are free"
        )
    _LOCKS.extend(lock for _, lock in found)
    return domains


def _free(domain: int) -> bool:
    """Whether the ports of a domain's first participants are free."""
    for participant in range(_PARTICIPANTS):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            try:
                probe.bind(("", 7410 + 250 * domain + 2 * participant))
            except OSError:
                return False
    return True


def _lock(domain: int) -> TextIO | None:
    """Return a lock that keeps a domain for this process, None where somebody else has it."""
    try:
        lock = (Path(tempfile.gettempdir()) / f"robot_ident_domain_{domain}.lock").open("a")
    except PermissionError:  # another user's
        return None
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        lock.close()
        return None
    return lock


def wait_for(
    what: Callable[[], bool],
    nodes: Sequence[NodeProcess],
    progress: Callable[[], Mapping[str, float]],
    patience: float,
    tick: Callable[[], None] = lambda: None,
) -> None:
    """Wait until `what()`, however long it takes while all goes on.

    RobotIdentError when a node ends first, or when one of the values of `progress()` has stayed the same for `patience`
    [s] of real time in which this process ran, too.
    """
    reached: dict[str, float] = {}
    still: dict[str, float] = {}
    before = time.monotonic()
    while not what():
        for node in nodes:
            if not node.running:
                node.end()
                raise RobotIdentError(f"node {node.node} ended too soon; its log: {node.log}")
        step, before = min(time.monotonic() - before, _LONGEST_LOOK), time.monotonic()
        for name, value in progress().items():
            still[name] = still.get(name, 0.0) + step if reached.get(name) == value else 0.0
            reached[name] = value
            if still[name] > patience:
                raise RobotIdentError(
                    f"{name} has stood still at {value:.1f} s for {patience:.0f} s; the nodes' logs:"
                    f" {nodes[0].log.parent.parent}"
                )
        tick()
        time.sleep(_LOOK)


def _text(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, list):
        return "[" + ", ".join(f"'{item}'" if isinstance(item, str) else str(item) for item in value) + "]"
    return str(value)

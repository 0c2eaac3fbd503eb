"""Identifies a robot from its live joint states and then shows how well the model follows it."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from datetime import datetime, timezone
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from rcl_interfaces.msg import SetParametersResult
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.parameter import Parameter as RosParameter
from rclpy.task import Future
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, String
from std_srvs.srv import Trigger

from robot_ident.errors import InputError, RobotIdentError
from robot_ident.estimation.identify import identify
from robot_ident.estimation.solve import ESTIMATORS
from robot_ident.model.model import Model
from robot_ident.model.model_file import read_model, write_model
from robot_ident.nodes.message_buffer import Intake
from robot_ident.nodes.messages import joint_state, labelled
from robot_ident.nodes.node import ERROR, OK, WARN, Abandoned, BaseNode, latched, reliable, run
from robot_ident.nodes.parameters import Parameter, live
from robot_ident.playback.commands import LocalMotion, LocalState
from robot_ident.playback.plan import PeriodCounter
from robot_ident.playback.stamps import Paired
from robot_ident.recording.effort import joint_torque
from robot_ident.recording.measurement import Processing
from robot_ident.recording.recording import Recording
from robot_ident.residuals.change_monitor import Change, RunningVerdict
from robot_ident.robot import Robot, load_robot
from robot_ident.signals.motion import Array, Motion
from robot_ident.trajectories.excitation import Excitation

TABLE: tuple[Parameter, ...] = (
    Parameter("robot", "kuka_ir361", "name of a robot, a robot YAML or a URDF"),
    Parameter(
        "trajectory", "", "excitation.yaml that is played: gives the base frequency ('' where base_frequency does)"
    ),
    Parameter(
        "base_frequency",
        0.0,
        "base frequency of the motion; 0: from the trajectory, or found in the data",
        0.0,
        100.0,
        unit="Hz",
    ),
    live("periods", 0, "identify after so many steady periods; 0: when the periodic motion ends", 0, 100_000),
    live(
        "each_period",
        True,
        "identify anew after every steady period from the third on, so that parameters and covariance are live; the"
        " last identification, at the end of the periods, is the one that output keeps",
    ),
    live("automatic", True, "identify at the end of the periods; otherwise only by ~/identify"),
    live("effects", [""], "further effects in the model, as NAME@JOINT ('' for none)"),
    live("estimator", "wls", "ls: eq. (10), wls: eq. (7)", choices=tuple(ESTIMATORS)),
    live("low_pass", 0.0, "low pass of torque and every column; 0: none on periods, else 10 Hz", 0.0, 1e4, unit="Hz"),
    Parameter(
        "output", "", "model.yaml to write after each identification ('' for none); it must not exist at the start"
    ),
    live("model", "", "model.yaml with which to predict, from the start or from when it is set ('' for none)"),
    Parameter(
        "memory", 0.0, "time for which joint states are kept; 0: enough for the periods, else 600 s", 0.0, 1e5, unit="s"
    ),
    Parameter(
        "window",
        0.0,
        "window of positions for velocity and acceleration of the prediction; 0: 0.2 s or less",
        0.0,
        10.0,
        unit="s",
    ),
    live("silence", 2.0, "identify what is there when joint_states are silent for so long", 0.1, 3600.0, unit="s"),
    live(
        "watch_window",
        0.0,
        "time over which the residual is compared with its first so long; 0: 2 periods of the motion, else 20 s",
        0.0,
        1e5,
        unit="s",
    ),
    live("watch_change", 0.02, "share of a joint's torque by which its friction must change to be told", 1e-4, 10.0),
    Parameter("depth", 5000, "joint states that may wait to be taken in", 1, 1_000_000),
)


_SPREAD = 0.05  # s between batches of predictions
_USUAL_PERIODS = 16
_USUAL_WINDOW = 0.2  # s
_USUAL_WATCH = 20.0  # s
_FEWEST = 3  # steady periods for which a provisional identification is worth while: one may still be transient
_LONGEST = 600.0  # s of memory where no period is known


class Estimator(BaseNode):
    """Keeps the joint states, identifies in a thread of its own, then publishes predicted and residual torque."""

    node_name: ClassVar[str] = "estimator"
    description: ClassVar[str] = "identifies a robot from its joint states and publishes predicted and residual torque"
    status_topic: ClassVar[str] = "~/diagnostics"
    table: ClassVar[tuple[Parameter, ...]] = TABLE

    def __init__(self) -> None:
        """Read robot, trajectory and model; subscribe."""
        super().__init__()
        self._robot = load_robot(self.value("robot"))
        excitation = Excitation.read(self.value("trajectory")) if self.value("trajectory") else None
        if excitation is not None:
            excitation.check_robot(self._robot)
        self._base_frequency = self.value("base_frequency") or (excitation.base_frequency if excitation else None)
        self._periods = PeriodCounter(1.0 / self._base_frequency) if self._base_frequency else None
        self._local = LocalMotion(self._window(excitation))
        if Path(self.value("output")).is_file():
            raise InputError(f"parameter output: {self.value('output')} exists already; give another name")
        self._written = False
        self._model = self._estimate = self._read(self.value("model"))
        self._tentative = False  # whether the model is of some of the periods only
        self._watch = RunningVerdict(self._robot.joints, self._watch_window())
        self._spacing: float | None = None  # s between the states
        self._used = 0  # messages received when the latest identification began
        self._fresh = False  # whether joint states came since the last silence
        self._busy: Future | None = None
        self._due = False  # whether the periods have ended and their identification hasn't begun
        self._seen_periods = 0
        self._worker: Abandoned | None = None
        self._renewed = False  # whether the model is another one than the watch has seen
        self._verdict: tuple[bytes, str] = (OK, "collecting")
        self._predicted = self.create_publisher(JointState, "~/predicted", reliable(1000))
        self._residual = self.create_publisher(JointState, "~/residual", reliable(1000))
        self._covariance = self.create_publisher(Float64MultiArray, "~/covariance", latched())
        self._said = self.create_publisher(String, "~/verdict", latched())
        self._last_said = ""
        self._intake = Intake(self, self._robot, self._memory(), self.value("depth"), self._receive)
        # in a group of its own: while one waits for an identification, joint states are taken in
        self.create_service(Trigger, "~/identify", self._on_identify, callback_group=ReentrantCallbackGroup())
        self.add_on_set_parameters_callback(self._on_model)
        self.every(_SPREAD, self._predict)
        self.every(0.2, self._look)
        self.every(1.0, self._tell)

    def _read(self, path: str) -> Model | None:
        """Return the model of a file, None of ''; InputError when it is another robot's."""
        model = read_model(path) if path else None
        if model is not None and model.robot.joints != self._robot.joints:
            raise InputError(f"{path}: its joints are not those of robot {self._robot.name}")
        return model

    def _on_model(self, changes: list[RosParameter]) -> SetParametersResult:
        """Predict with another model from now on, where it can be read."""
        for change in changes:
            if change.name == "model":
                try:
                    self._take(self._read(change.value))
                except RobotIdentError as error:
                    return SetParametersResult(successful=False, reason=str(error))
                self._verdict = (OK, f"predicts with {change.value}" if change.value else "collecting")
        return SetParametersResult(successful=True)

    def _take(self, model: Model | None, *, provisional: bool = False) -> None:
        """Tell of a model, and predict with it unless it is provisional and the present one is not."""
        self._estimate = model
        if not provisional or self._model is None or self._tentative:
            if self._model is None:
                self._local.reset()
            self._model, self._renewed, self._tentative = model, True, provisional
        if model is not None:
            self._covariance.publish(labelled(model.covariance, [one.name for one in model.structure.parameters]))

    def _memory(self) -> float:
        given: float = self.value("memory")
        if given or not self._base_frequency:
            return given or _LONGEST
        return float((max(self.value("periods"), _USUAL_PERIODS) + 4) / self._base_frequency + 60.0)

    def _window(self, excitation: Excitation | None) -> float:
        """Return the window of the derivatives: not longer than 0.4 periods of the fastest harmonic."""
        given: float = self.value("window")
        fastest = excitation.base_frequency * excitation.harmonics if excitation else 0.0
        return given or (min(_USUAL_WINDOW, 0.4 / fastest) if fastest else _USUAL_WINDOW)

    def _watch_window(self) -> float:
        given: float = self.value("watch_window")
        return given or (2.0 / self._base_frequency if self._base_frequency else _USUAL_WATCH)

    # --- joint states

    def _receive(self, stamp: int, q: Array) -> None:
        if not np.isfinite(q).all():
            self._local.reset()
            return
        self._fresh = True
        if self._periods is None:
            return
        # identify at the end of the periods, and before it after each
        if self._periods.add(stamp * 1e-9, q, self.value("periods")):
            self._automatic()
        whole = int(self._periods.periods)
        if whole > self._seen_periods and whole >= _FEWEST and self.value("each_period"):
            self._automatic(provisional=True)
        self._seen_periods = whole

    def _look(self) -> None:
        """Identify what is there once the joint states have fallen silent (a replay is over)."""
        if self._due and self._busy is None:
            self._begin()
        new = self._intake.received - self._used
        if new > 0 and self._fresh and time.monotonic() - self._intake.last > self.value("silence"):
            self._fresh = False
            self._automatic()

    def _automatic(self, *, provisional: bool = False) -> None:
        """Identify now, or as soon as the one before is done; a provisional one isn't waited for."""
        if self.value("automatic") and self._busy is None:
            self._begin(provisional=provisional)
        elif self.value("automatic") and not provisional:
            self._due = True

    # --- identification

    def _begin(self, *, provisional: bool = False) -> Future:
        """Identify in a thread of its own; return what its answer will be: (success, text)."""
        done: Future = Future(executor=self.executor)
        if not provisional:
            self._used, self._due = self._intake.received, False
        self._busy = done
        options = {
            "effects": self.texts("effects"),
            "estimator": self.value("estimator"),
            "processing": Processing(
                base_frequency=self._base_frequency,
                periodic=True if self._base_frequency else None,
                low_pass=self.value("low_pass") or None,
            ),
        }
        recorded = self._intake.snapshot()
        self._worker = Abandoned(
            target=self._work, args=(done, recorded, options, provisional), name="identify", daemon=True
        )
        self._worker.start()
        return done

    def _work(
        self, done: Future, recorded: Callable[[], Recording], options: dict[str, Any], provisional: bool
    ) -> None:
        try:
            answer = self._identify(recorded(), options, provisional)
        except RobotIdentError as error:
            answer = (False, str(error))
            if not provisional:
                self._verdict = (ERROR, str(error))
                self.get_logger().error(str(error))
        except BaseException as error:
            self.fail(error)
            raise
        finally:
            self._busy = None
        done.set_result(answer)

    def _identify(self, recording: Recording, options: dict[str, Any], provisional: bool) -> tuple[bool, str]:
        begun = time.monotonic()
        # what is said on the way has no time for a choice
        robot = replace(self._robot, base="declared") if provisional else self._robot
        model = identify([recording], robot, **options)
        if self.ended:
            return False, "the node ends"
        provenance = {
            "date": datetime.now(timezone.utc).isoformat(timespec="seconds"),
            "recordings": [
                {
                    "topic": self.resolve_topic_name(self._intake.states),
                    "samples": recording.samples,
                    "start_ns": recording.start_ns,
                }
            ],
        }
        model = replace(model, provenance=provenance)
        if self.value("output") and not provisional:
            write_model(model, self.value("output"), force=self._written)
            self._written = True
        self._take(model, provisional=provisional)
        text = (
            f"{len(model.values)} parameters from {model.noise.periods} periods, {recording.samples} samples,"
            f" in {time.monotonic() - begun:.2f} s"
        )
        self._verdict = (OK, f"{text}{', so far' if provisional else ''}")
        if not provisional:
            self.get_logger().info(text)
        return True, text

    async def _on_identify(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        while self._busy is not None:
            await self._busy
        response.success, response.message = await self._begin()
        return response

    # --- prediction and diagnostics

    def _predict(self) -> None:
        """Publish predicted and residual torque of the states that came since the last time, and watch the residual."""
        paired, model = self._intake.take(), self._model
        if model is None or not paired:
            return
        states = self._states_of(paired, model.robot)
        if not states:
            return
        q, dq, ddq = (np.concatenate([getattr(s.motion, name) for s in states]) for name in ("q", "dq", "ddq"))
        if len(states) > 1:
            self._spacing = float(np.median(np.diff([s.stamp_ns for s in states]))) * 1e-9
        motion = Motion(q, dq, ddq, dt=self._spacing)
        torques = model.predict(motion)
        measured = np.array([state.tau for state in states])
        if self._renewed or self._watch.window != self._watch_window():
            self._renewed = False
            self._watch = RunningVerdict(self._robot.joints, self._watch_window())
        self._watch.add(np.array([state.stamp_ns for state in states]) * 1e-9, dq, measured - torques, measured)
        for state, predicted in zip(states, torques, strict=True):
            self._predicted.publish(joint_state(self._robot.joints, state.stamp_ns, tau=predicted))
            self._residual.publish(joint_state(self._robot.joints, state.stamp_ns, tau=state.tau - predicted))

    def _states_of(self, paired: Sequence[Paired], robot: Robot) -> list[LocalState]:
        """Return the motion and the torque at the joints in the middle of each window that is full by now."""
        torque = joint_torque(np.array([one.tau for one in paired]), np.array([one.q for one in paired]), robot)
        rows = zip(paired, torque, strict=True)
        moved = [self._local.add(one.stamp_ns, one.q, tau) for one, tau in rows if np.isfinite(one.q).all()]
        return [state for state in moved if state is not None]

    def _running(self) -> tuple[list[Change], dict[str, object]]:
        """Return the joints that have changed, and the live residual of all."""
        changes = self._watch.changes()
        values: dict[str, object] = {"watch": f"{100 * self._watch.progress:.0f} % of two windows seen"}
        for change in changes:
            values[f"live residual {change.joint}"] = f"{change.rms:.4g} rms, at first {change.first_rms:.4g}"
            values[f"change {change.joint}"] = change.in_words.partition(": ")[2]
        return [change for change in changes if change.changed(self.value("watch_change"))], values

    def _tell(self) -> None:
        level, text = self._verdict
        changed, live = self._running() if self._model is not None else ([], {})
        if self._busy is not None:
            text = "identifying"
        elif changed and level == OK:
            level, text = WARN, "the robot has changed: " + "; ".join(change.in_words for change in changed)
        values: dict[str, object] = {"samples": len(self._intake), "received": self._intake.received}
        if self._periods is not None:
            values["steady periods"] = f"{self._periods.periods:.2f}"
        model = self._estimate
        if model is not None:
            values |= {
                parameter.name: f"{value:.6g} +- {std:.2g} {parameter.unit}"
                for parameter, value, std in zip(model.structure.parameters, model.values, model.std, strict=True)
            }
            values |= {f"residual {joint}": f"{fit.rms:.4g}" for joint, fit in model.residual.items()}
            values["condition number"] = f"{model.condition_number:.4g}"
            values |= live
        elif level == OK and not self._intake.last:
            level, text = WARN, f"no {self._intake.states} yet"
        lacking = self._intake.problem(self.value("silence"))
        if lacking:
            level, text = max(level, WARN), f"{text}; {lacking}"
        self.tell(level, text, values)
        if text != self._last_said:
            self._last_said = text
            self._said.publish(String(data=text))

    def close(self) -> None:
        """Leave an identification that is under way to itself."""
        self.end()
        if self._worker is not None:
            self._worker.join(0.3)


main = partial(run, Estimator)

if __name__ == "__main__":
    raise SystemExit(main())

"""Identifies a robot from its live joint states and then shows how well the model follows it."""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence
from dataclasses import replace
from datetime import datetime, timezone
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.serialization import deserialize_message
from rclpy.task import Future
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from robot_ident.diagnosis.running import Change, RunningVerdict
from robot_ident.errors import InputError, RobotIdentError
from robot_ident.estimation.identify import identify
from robot_ident.estimation.solve import ESTIMATORS
from robot_ident.excitation.excitation import Excitation
from robot_ident.model.model import Model
from robot_ident.model.model_file import read_model, write_model
from robot_ident.motion import Array, Motion
from robot_ident.nodes.collector import Collector
from robot_ident.nodes.common import ERROR, OK, WARN, BaseNode, overridable, reliable, run
from robot_ident.nodes.joint_states import columns, joint_state, stamp_of
from robot_ident.nodes.parameters import Parameter
from robot_ident.playing.local_motion import LocalMotion, LocalState
from robot_ident.playing.periods import PeriodCounter
from robot_ident.recording.measurement import Processing
from robot_ident.robot import load_robot

_SPREAD = 0.05  # s between batches of predictions
_USUAL_PERIODS = 16
_USUAL_WINDOW = 0.2  # s
_USUAL_WATCH = 20.0  # s
_LONGEST = 600.0  # s of memory where no period is known


class Estimator(BaseNode):
    """Keeps the joint states, identifies in a thread of its own, then publishes predicted and residual torque."""

    node_name: ClassVar[str] = "estimator"
    description: ClassVar[str] = "identifies a robot from its joint states and publishes predicted and residual torque"
    table: ClassVar[tuple[Parameter, ...]] = (
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
        Parameter(
            "periods",
            0,
            "identify after so many steady periods; 0: when the periodic motion ends",
            0,
            100_000,
            live=True,
        ),
        Parameter("automatic", True, "identify at the end of the periods; otherwise only by ~/identify", live=True),
        Parameter("effects", [""], "further effects in the model, as NAME@JOINT ('' for none)", live=True),
        Parameter("estimator", "wls", "ls: eq. (10), wls: eq. (7)", choices=tuple(ESTIMATORS), live=True),
        Parameter(
            "low_pass",
            0.0,
            "low pass of torque and every column; 0: none on periods, else 10 Hz",
            0.0,
            1e4,
            unit="Hz",
            live=True,
        ),
        Parameter(
            "output", "", "model.yaml to write after each identification ('' for none); it must not exist at the start"
        ),
        Parameter("model", "", "model.yaml with which to predict from the start ('' for none)"),
        Parameter(
            "memory",
            0.0,
            "time for which joint states are kept; 0: enough for the periods, else 600 s",
            0.0,
            1e5,
            unit="s",
        ),
        Parameter(
            "window",
            0.0,
            "window of positions for velocity and acceleration of the prediction; 0: 0.2 s or less",
            0.0,
            10.0,
            unit="s",
        ),
        Parameter(
            "silence",
            2.0,
            "identify what is there when joint_states are silent for so long",
            0.1,
            3600.0,
            unit="s",
            live=True,
        ),
        Parameter(
            "watch_window",
            0.0,
            "time over which the residual is compared with its first so long; 0: 2 periods of the motion, else 20 s",
            0.0,
            1e5,
            unit="s",
            live=True,
        ),
        Parameter(
            "watch_change",
            0.02,
            "share of a joint's torque by which its friction must change to be told",
            1e-4,
            10.0,
            live=True,
        ),
        Parameter("depth", 5000, "joint states that may wait to be taken in", 1, 1_000_000),
    )

    def __init__(self) -> None:
        """Read robot, trajectory and model; subscribe."""
        super().__init__()
        self._robot = load_robot(self.value("robot"))
        excitation = Excitation.read(self.value("trajectory")) if self.value("trajectory") else None
        if excitation is not None:
            excitation.check_robot(self._robot)
        self._base_frequency = self.value("base_frequency") or (excitation.base_frequency if excitation else None)
        self._periods = PeriodCounter(1.0 / self._base_frequency) if self._base_frequency else None
        self._collector = Collector(self._memory(), "joint_states")
        self._local = LocalMotion(self._window(excitation))
        if Path(self.value("output")).is_file():
            raise InputError(f"parameter output: {self.value('output')} exists already; give another name")
        self._written = False
        self._model: Model | None = read_model(self.value("model")) if self.value("model") else None
        if self._model is not None and self._model.robot.joints != self._robot.joints:
            raise InputError(f"{self.value('model')}: its joints are not those of robot {self._robot.name}")
        self._watch = RunningVerdict(self._robot.joints, self._watch_window())
        self._states: list[LocalState] = []
        self._spacing: float | None = None  # s between the states
        self._last = 0.0  # s, when the latest joint state came
        self._used = 0  # messages received when the latest identification began
        self._fresh = False  # whether joint states came since the last silence
        self._busy: Future | None = None
        self._worker: threading.Thread | None = None
        self._renewed = False  # whether the model is another one than the watch has seen
        self._verdict: tuple[bytes, str] = (OK, "collecting")
        self._predicted = self.create_publisher(JointState, "~/predicted", reliable(1000))
        self._residual = self.create_publisher(JointState, "~/residual", reliable(1000))
        self._diagnostics = self.create_publisher(DiagnosticArray, "~/diagnostics", 10)
        self.create_subscription(
            JointState,
            "joint_states",
            self._receive,
            reliable(self.value("depth")),
            raw=True,
            qos_overriding_options=overridable(),
        )
        self.create_service(Trigger, "~/identify", self._on_identify)
        self.every(_SPREAD, self._predict)
        self.every(0.2, self._look)
        self.every(1.0, self._tell)

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

    def _receive(self, data: bytes, info: dict[str, Any]) -> None:
        message = deserialize_message(data, JointState)
        received = info["received_timestamp"] or time.time_ns()
        stamp = stamp_of(message) or received
        self._collector.add(stamp, received, data)
        self._last = time.monotonic()
        values = columns(message, self._robot.joints)
        if values is None:
            return
        q, _, tau = values
        if not np.isfinite(q).all():
            self._local.reset()
            return
        if self._periods is not None and self._periods.add(stamp * 1e-9, q, self.value("periods")):
            self._automatic()
        self._fresh = True
        if self._model is not None and tau is not None:
            state = self._local.add(stamp, q, tau)
            if state is not None:
                self._states.append(state)

    def _look(self) -> None:
        """Identify what is there once the joint states have fallen silent (a replay is over)."""
        new = self._collector.received - self._used
        if new > 0 and self._fresh and time.monotonic() - self._last > self.value("silence"):
            self._fresh = False
            self._automatic()

    def _automatic(self) -> None:
        if self.value("automatic") and self._busy is None:
            self._begin()

    # --- identification

    def _begin(self) -> Future:
        """Identify in a thread of its own; return what its answer will be: (success, text)."""
        done: Future = Future(executor=self.executor)
        self._used = self._collector.received
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
        messages = self._collector.snapshot()
        self._worker = threading.Thread(target=self._work, args=(done, messages, options), name="identify", daemon=True)
        self._worker.start()
        return done

    def _work(self, done: Future, messages: list[tuple[int, int, bytes]], options: dict[str, Any]) -> None:
        try:
            answer = self._identify(messages, options)
        except RobotIdentError as error:
            answer = (False, str(error))
            self._verdict = (ERROR, str(error))
            self.get_logger().error(str(error))
        except BaseException as error:
            self.fail(error)
            raise
        finally:
            self._busy = None
        done.set_result(answer)

    def _identify(self, messages: list[tuple[int, int, bytes]], options: dict[str, Any]) -> tuple[bool, str]:
        begun = time.monotonic()
        recording = self._collector.recording(messages, self._robot.joints)
        model = identify([recording], self._robot, **options)
        provenance = {
            "date": datetime.now(timezone.utc).isoformat(timespec="seconds"),
            "recordings": [
                {
                    "topic": self.resolve_topic_name("joint_states"),
                    "samples": recording.samples,
                    "start_ns": recording.start_ns,
                }
            ],
        }
        model = replace(model, provenance=provenance)
        if self.value("output"):
            write_model(model, self.value("output"), force=self._written)
            self._written = True
        if self._model is None:
            self._local.reset()
        self._model = model
        self._renewed = True
        text = (
            f"{len(model.values)} parameters from {model.noise.periods} periods, {recording.samples} samples,"
            f" in {time.monotonic() - begun:.2f} s"
        )
        self._verdict = (OK, text)
        self.get_logger().info(text)
        return True, text

    async def _on_identify(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        while self._busy is not None:
            await self._busy
        response.success, response.message = await self._begin()
        return response

    # --- prediction and diagnostics

    def _predict(self) -> None:
        """Publish predicted and residual torque of the states that came since the last time."""
        model, states = self._model, self._states
        if model is None or not states:
            return
        self._states = []
        q, dq, ddq = (np.concatenate([getattr(s.motion, name) for s in states]) for name in ("q", "dq", "ddq"))
        if len(states) > 1:
            self._spacing = float(np.median(np.diff([s.stamp_ns for s in states]))) * 1e-9
        motion = Motion(q, dq, ddq, dt=self._spacing)
        torques = model.predict(motion)
        self._observe(states, dq, torques)
        for state, predicted in zip(states, torques, strict=True):
            self._predicted.publish(joint_state(self._robot.joints, state.stamp_ns, tau=predicted))
            self._residual.publish(joint_state(self._robot.joints, state.stamp_ns, tau=state.tau - predicted))

    def _observe(self, states: list[LocalState], dq: Array, predicted: Array) -> None:
        """Hand the residual to the running verdict."""
        if self._renewed or self._watch.window != self._watch_window():
            self._renewed = False
            self._watch = RunningVerdict(self._robot.joints, self._watch_window())
        t = np.array([state.stamp_ns for state in states]) * 1e-9
        measured = np.array([state.tau for state in states])
        self._watch.add(t, dq, measured - predicted, measured)

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
        values: dict[str, object] = {"samples": len(self._collector), "received": self._collector.received}
        if self._periods is not None:
            values["steady periods"] = f"{self._periods.periods:.2f}"
        model = self._model
        if model is not None:
            values |= {
                parameter.name: f"{value:.6g} +- {std:.2g} {parameter.unit}"
                for parameter, value, std in zip(model.structure.parameters, model.values, model.std, strict=True)
            }
            values |= {f"residual {joint}": f"{fit.rms:.4g}" for joint, fit in model.residual.items()}
            values["condition number"] = f"{model.condition_number:.4g}"
            values |= live
        elif level == OK and not self._last:
            level, text = WARN, "no joint_states yet"
        self._diagnostics.publish(self.status_array(level, text, values))

    def close(self) -> None:
        """Leave an identification that is under way to itself: its thread ends with the process."""
        self.end()
        if self._worker is not None:
            self._worker.join(0.3)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the estimator."""
    return run(Estimator, argv)


if __name__ == "__main__":
    raise SystemExit(main())

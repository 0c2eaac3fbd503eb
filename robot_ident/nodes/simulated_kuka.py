"""A simulated robot in real time: follows joint commands and reports joint states as a real one would, efforts as its
YAML declares them, on the topics that it names.
"""

from __future__ import annotations

from collections import deque
from functools import partial
from typing import ClassVar

import numpy as np
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectory

from robot_ident.errors import InputError
from robot_ident.nodes.effort_topics import KINDS, sources_of, topics_of
from robot_ident.nodes.messages import columns, joint_state, points_of, stamp_of
from robot_ident.nodes.node import THREAD_PRIORITY, BaseNode, overridable, reliable, run
from robot_ident.nodes.parameters import Parameter
from robot_ident.nodes.subscriptions import poll
from robot_ident.playback.commands import CommandBuffer
from robot_ident.playback.periodic_timer import Stall, Ticker
from robot_ident.recording.effort import as_reported
from robot_ident.robot import Robot, load_robot
from robot_ident.signals.motion import Array, Motion
from robot_ident.testbed.real_time import CommandInterpolator, SimulatedRobot, TrajectoryFollower
from robot_ident.testbed.servo import BANDWIDTH, SERVOS


class ReportedStates:
    """The topic `joint_states`, and beside it those that hold efforts."""

    def __init__(self, node: BaseNode, robot: Robot, depth: int) -> None:
        """Make the publishers."""
        self._robot, sources = robot, sources_of(robot, node)
        self._sources = sources
        self._places = {name: robot.joints.index(name) for name in sources}
        self._states = node.create_publisher(
            JointState, "joint_states", reliable(depth), qos_overriding_options=overridable()
        )
        self._others = {
            topic: node.create_publisher(KINDS[kind], topic, reliable(depth), qos_overriding_options=overridable())
            for topic, kind in topics_of(sources).items()
        }

    def publish(self, stamp_ns: int, q: Array, dq: Array, tau: Array) -> None:
        """Publish positions q [n] rad, velocities dq [n] and the torque tau [n] Nm at the joints, as reported."""
        reported = as_reported(tau[None], q[None], self._robot)[0]
        if not self._places:
            self._states.publish(joint_state(self._robot.joints, stamp_ns, q, dq, reported))
            return
        beside, rates = reported.copy(), dq.copy()
        for name, place in self._places.items():
            beside[place] = 0.0
            if self._sources[name].topic is None:
                rates[place] = reported[place]
        whole = len(self._places) == self._robot.n
        self._states.publish(joint_state(self._robot.joints, stamp_ns, q, rates, None if whole else beside))
        for topic, publisher in self._others.items():
            publisher.publish(self._message(topic, stamp_ns, reported))

    def _message(self, topic: str, stamp_ns: int, reported: Array) -> JointState | Float64MultiArray:
        own = {name: one for name, one in self._sources.items() if one.topic == topic}
        values = {name: float(reported[self._places[name]]) for name in own}
        indices = {one.index: values[name] for name, one in own.items() if one.index is not None}
        if indices:
            return Float64MultiArray(data=[indices.get(k, 0.0) for k in range(max(indices) + 1)])
        message = joint_state(tuple(own), stamp_ns)
        for field in {one.field for one in own.values()}:
            setattr(message, field, [values[name] if one.field == field else np.nan for name, one in own.items()])
        return message


_LAG = 0.1  # s of commands that may wait; those of a stall are left out, or the robot would be late ever after


class SimulatedKuka(BaseNode):
    """Advances `SimulatedRobot` by one sample a tick and publishes what its sensors say, on an even grid of stamps."""

    node_name: ClassVar[str] = "simulated_kuka"
    description: ClassVar[str] = "a simulated robot that follows joint_command and publishes joint_states in real time"
    table: ClassVar[tuple[Parameter, ...]] = (
        Parameter("robot", "kuka_ir361", "name of a robot, a robot YAML or a URDF"),
        Parameter("rate", 150.0, "rate of joint_states", 1.0, 2000.0, unit="Hz"),
        Parameter("step_rate", 0.0, "rate of the dynamics, a multiple of rate; 0: 1 kHz or finer", 0.0, 1e5, unit="Hz"),
        Parameter("servo", "feedforward", "; ".join(f"{k}: {v}" for k, v in SERVOS.items()), choices=tuple(SERVOS)),
        Parameter("bandwidth", BANDWIDTH, "bandwidth of the position controllers", 0.1, 200.0, unit="Hz"),
        Parameter("effects", [""], "further phenomena of the plant, as NAME@JOINT or NAME@JOINT:k=v,... ('' for none)"),
        Parameter("noise", 1.0, "factor of the robot's noise variances; 0: no noise", 0.0, 1e6),
        Parameter("seed", 0, "seed of the noise", 0, 2**31 - 1),
        Parameter(
            "initial_position",
            [0.0],
            "where it stands at the start and after ~/reset; one value, or one a joint; brought within the limits",
            -1e3,
            1e3,
            unit="rad or m",
        ),
        Parameter(
            "controller",
            "",
            "name of a joint_trajectory_controller to stand in for: it follows NAME/joint_trajectory instead of"
            " joint_command ('' for none)",
        ),
        Parameter(
            "delay", 0.05, "how long commands wait, so that late ones don't disturb the motion", 0.0, 1.0, unit="s"
        ),
        Parameter(
            "patience", 0.1, "how long it moves on when commands stop, before it brakes and holds", 0.0, 10.0, unit="s"
        ),
        Parameter("depth", 1000, "joint states that a slow reader may leave waiting", 1, 1_000_000),
        THREAD_PRIORITY,
    )

    def __init__(self) -> None:
        """Build the plant and start its clock; InputError on an unknown robot, effect or rate."""
        super().__init__()
        robot = load_robot(self.value("robot"))
        rate = self.value("rate")
        self._joints = robot.joints
        self._interval_ns = 1e9 / rate
        self._plant = SimulatedRobot(
            robot,
            sample_rate=rate,
            step_rate=self.value("step_rate") or None,
            servo=self.value("servo"),
            bandwidth=self.value("bandwidth"),
            effects=self.texts("effects"),
            noise=self.value("noise"),
        )
        start = np.array(self.per_joint("initial_position", robot.joints))
        self._start: Array = np.clip(start, robot.limits.lower, robot.limits.upper)
        self._interpolator = CommandInterpolator(robot.limits.acceleration, 1.0 / rate, patience=self.value("patience"))
        self._buffer = CommandBuffer(self.value("delay"))
        self._follower = TrajectoryFollower(robot.n) if self.value("controller") else None
        self._taken: deque[tuple[int, Array, Motion]] = deque()
        self._rng = np.random.default_rng(self.value("seed"))
        self._resets = 1
        self._origin_ns: int | None = None
        self._epoch_ns = 0
        self._states = ReportedStates(self, robot, self.value("depth"))
        if self._follower is None:
            self._take_commands = poll(self, JointState, "joint_command", self._on_command, reliable(1000))
        else:
            topic = f"{self.value('controller').rstrip('/')}/joint_trajectory"
            self._take_commands = poll(self, JointTrajectory, topic, self._on_trajectory, reliable(10))
        self.create_service(Trigger, "~/reset", self._on_reset)
        self._ticker = Ticker(
            rate,
            self._tick,
            late="catch_up",
            stall=1.0,
            on_stall=self._on_stall,
            on_error=self.fail,
            clock=(lambda: self.now_ns() * 1e-9) if self.get_parameter("use_sim_time").value else None,
            priority=self.tick_priority(),
        )
        self.get_logger().info(f"{robot.name} with {', '.join(self._plant.effects) or 'no effects'}")
        self._ticker.start()

    def _on_command(self, message: JointState) -> None:
        values = columns(message, self._joints)
        if values is None:
            self.get_logger().warning(
                f"a command without positions of {', '.join(self._joints)} is left out", throttle_duration_sec=5.0
            )
            return
        q, dq, _ = values
        dq = np.zeros(len(q)) if dq is None else dq
        if not (np.isfinite(q).all() and np.isfinite(dq).all()):
            self.get_logger().warning("a command that is not a number is left out", throttle_duration_sec=5.0)
            return
        self._buffer.put(stamp_of(message), self.now_ns(), q, dq)

    def _on_trajectory(self, message: JointTrajectory) -> None:
        points = points_of(message, self._joints)
        if points is None:
            self.get_logger().warning("a trajectory without positions, velocities and accelerations is left out")
            return
        self._taken.append((stamp_of(message) or self.now_ns(), *points))

    def _tick(self, number: int) -> None:
        """Advance by one sample and report; in the ticker's thread."""
        if self._origin_ns is None:
            self._origin_ns = self.now_ns() - round(self._ticker.late * 1e9 + number * self._interval_ns)
        stamp = self._origin_ns + round(number * self._interval_ns)
        self._take_commands()  # what came before a reset goes with it
        if self._resets:
            self._resets = 0
            self._plant.reset(self._start)
            self._interpolator.reset(self._start)
            self._buffer.clear()
            if self._follower is not None:
                self._follower.reset(self._start)
        self._plant.advance(self._reference(stamp))
        reading = self._plant.measure(self._rng)
        self._states.publish(stamp, reading.q, reading.dq, reading.tau)

    def _reference(self, stamp: int) -> Motion:
        """Return the reference of the sample that ends at `stamp` [ns], at every half step of the dynamics."""
        instants, half = 2 * self._plant.steps_per_sample, 0.5 * self._plant.step
        if self._follower is not None:
            self._epoch_ns = self._epoch_ns or stamp
            begin = (stamp - self._epoch_ns - self._interval_ns) * 1e-9
            while self._taken:
                start_ns, t, motion = self._taken.popleft()
                try:
                    self._follower.take(begin, (start_ns - self._epoch_ns) * 1e-9 + t, motion)
                except InputError as error:
                    self.get_logger().warning(f"{error} is refused", throttle_duration_sec=1.0)
            return self._follower.at(begin + half * np.arange(1, instants + 1))
        for command in self._buffer.due(stamp):
            self._epoch_ns = self._epoch_ns or command.t_ns
            self._interpolator.push((command.t_ns - self._epoch_ns) * 1e-9, command.q, command.dq)
        if self._interpolator.behind > max(_LAG, 3e-9 * self._interval_ns):
            self._interpolator.catch_up()
        return self._interpolator.advance(instants, half)

    def _on_stall(self, stall: Stall) -> None:
        """Begin the grid of stamps anew; what was commanded goes along with a clock that has jumped."""
        self._origin_ns = None
        if stall.clock_jump:
            jump_ns = round(stall.seconds * 1e9)
            self._buffer.shift(jump_ns)
            self._epoch_ns += jump_ns if self._epoch_ns else 0
        what = (
            str(stall) if stall.clock_jump else f"{stall.seconds:.3f} s behind (a loaded machine, or a stopped process)"
        )
        self.get_logger().warning(f"{what}: the stamps of joint_states have a gap")

    def _on_reset(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._resets = 1
        response.success, response.message = True, f"at {self._start.tolist()}"
        return response

    def close(self) -> None:
        """Join the thread."""
        self.end()
        self._ticker.stop()
        timing = self._ticker.timing
        self.get_logger().info(
            f"{timing.ticks} samples, worst lateness {1e3 * timing.worst:.2f} ms, {timing.stalls} stalls"
        )


main = partial(run, SimulatedKuka)

if __name__ == "__main__":
    raise SystemExit(main())

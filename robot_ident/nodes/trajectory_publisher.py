"""Plays a trajectory on a robot: approach, periods, hold, and a smooth stop whenever something is wrong."""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence
from typing import ClassVar

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64
from std_srvs.srv import Trigger

from robot_ident.errors import CheckFailed, InputError, RobotIdentError
from robot_ident.excitation.excitation import Excitation
from robot_ident.excitation.limits import certify
from robot_ident.excitation.playback import Playback, approach, stop_from
from robot_ident.excitation.point_to_point import load_motion
from robot_ident.excitation.reference import Reference
from robot_ident.nodes.common import ERROR, OK, WARN, BaseNode, overridable, reliable, run
from robot_ident.nodes.joint_states import stamp_of
from robot_ident.nodes.neighbours import Neighbours
from robot_ident.nodes.outputs import OUTPUTS, Output, SampleOutput, TrajectoryOutput
from robot_ident.nodes.parameters import Parameter
from robot_ident.playing.player import DWELL, Phase, Player
from robot_ident.playing.progress import progress
from robot_ident.playing.slowed import Slowed
from robot_ident.playing.ticker import Stall, Ticker
from robot_ident.playing.watch import Bounds, Watch
from robot_ident.robot import Robot, load_robot

_LONGEST_STOP = 2.0  # s that the end of the node waits for a smooth stop
_USUAL_RATE = 150.0  # Hz


class TrajectoryPublisher(BaseNode):
    """Sends position and velocity of a certified trajectory; the phases are those of `Player`."""

    node_name: ClassVar[str] = "trajectory_publisher"
    description: ClassVar[str] = "plays an excitation or a validation motion on a robot, within its limits"
    table: ClassVar[tuple[Parameter, ...]] = (
        Parameter("robot", "kuka_ir361", "name of a robot, a robot YAML or a URDF"),
        Parameter("trajectory", "", "excitation.yaml or validation motion to play"),
        Parameter("periods", 16, "steady periods to play, after one transient period", 1, 100_000),
        Parameter("rate", 0.0, "rate of the commands; 0: the sample rate of the trajectory", 0.0, 2000.0, unit="Hz"),
        Parameter("speed", 1.0, "share of the designed speed at which all is played", 0.01, 1.0),
        Parameter(
            "rehearsal",
            [0.0],
            "shares of the designed speed at which one period is played first, as [0.1, 0.3] (0: none); the next"
            " follows only where tracking error and effort stayed within rehearsal_margin of their bounds",
            0.0,
            1.0,
        ),
        Parameter("rehearsal_margin", 0.7, "share of its bounds that a rehearsal may use", 0.01, 1.0),
        Parameter("output", "joint_state", "; ".join(f"{k}: {v}" for k, v in OUTPUTS.items()), choices=tuple(OUTPUTS)),
        Parameter(
            "controller",
            "",
            "name of the robot's controller, which must hold by itself when commands stop; without one only a"
            " simulated robot is moved",
        ),
        Parameter(
            "speed_scaling_topic",
            "",
            "topic (std_msgs/Float64) on which the robot tells its speed scaling: anything but 1, or 100, stops the"
            " motion ('' for none)",
        ),
        Parameter("autostart", False, "start as soon as the robot is there; otherwise by ~/start"),
        Parameter(
            "exit_when_done", False, "end the node after the motion (exit code 3 where it was stopped for a reason)"
        ),
        Parameter(
            "hold_time",
            0.5,
            "how long the last position is held before exit_when_done ends the node",
            0.0,
            3600.0,
            unit="s",
        ),
        Parameter(
            "state_wait",
            30.0,
            "how long the robot's state is waited for at the start",
            0.1,
            3600.0,
            unit="s",
            live=True,
        ),
        Parameter(
            "state_timeout", 0.25, "stop when no new joint state comes for so long", 0.01, 10.0, unit="s", live=True
        ),
        Parameter(
            "tracking_error",
            [0.1],
            "stop when a joint is so far from where it was sent within 0.15 s; one value, or one a joint",
            1e-6,
            10.0,
            unit="rad or m",
            live=True,
        ),
        Parameter(
            "effort_limit", 1.25, "stop beyond so many times the robot's torque limit; 0: never", 0.0, 100.0, live=True
        ),
        Parameter("exclusive", True, "stop when another node publishes on joint_command as well", live=True),
        Parameter(
            "stall",
            0.2,
            "command nothing more when this process stood still for so long in a motion",
            0.01,
            10.0,
            unit="s",
        ),
        Parameter("depth", 10, "commands that may wait to be sent", 1, 10_000),
    )

    def __init__(self) -> None:
        """Load and certify the trajectory; InputError when it isn't safe for this robot."""
        super().__init__()
        self._robot = load_robot(self.value("robot"))
        self._motion, self._rehearsals, rate = self._load(self._robot)
        self._watch = Watch(self._robot.joints, self._bounds())
        self._output = self._make_output()
        self._neighbours = Neighbours(self, self._output.publisher)
        self._player = Player(
            self._motion,
            lambda q: approach(q, self._motion.start_pose, self._robot),
            lambda motion: stop_from(motion, self._robot),
            self._watch,
            rehearsals=self._rehearsals,
            judge=self._judge,
            lead=self._output.lead,
            dwell=DWELL + 5 * self._output.lead,
        )
        self._told = Phase.IDLE
        self._resting = 0.0
        self._ending = 0.0
        self._origin_ns: int | None = None
        self._preparing: threading.Thread | None = None
        self._status = self.create_publisher(DiagnosticArray, "~/status", 10)
        self.create_subscription(
            JointState, "joint_states", self._on_state, reliable(100), qos_overriding_options=overridable()
        )
        if self.value("speed_scaling_topic"):
            self.create_subscription(
                Float64,
                self.value("speed_scaling_topic"),
                self._on_speed_scaling,
                reliable(10),
                qos_overriding_options=overridable(),
            )
        self.create_service(Trigger, "~/start", self._on_start)
        self.create_service(Trigger, "~/stop", self._on_stop)
        self.every(0.1, self._look)
        self.every(0.5, self._tell)
        self.add_post_set_parameters_callback(lambda changes: setattr(self._watch, "bounds", self._bounds()))
        simulated = self.get_parameter("use_sim_time").value
        self._ticker = Ticker(
            rate,
            self._tick,
            # a simulated robot waits for what is late, a real one has moved on
            late="catch_up" if simulated else "skip",
            stall=min(1.0 if simulated else self.value("stall"), self._output.longest_stall),
            on_stall=self._on_stall,
            on_error=self.fail,
            clock=(lambda: self.now_ns() * 1e-9) if simulated else None,
        )
        self.get_logger().warning(
            "this is no safety function: keep the emergency stop at hand, and see that the robot's controller holds"
            " by itself when commands stop"
        )
        self._ticker.start()
        if self.value("autostart"):
            self._start()

    def _load(self, robot: Robot) -> tuple[Reference, tuple[Slowed, ...], float]:
        """Return the motion to play, its rehearsals and its rate; InputError when a limit of the robot isn't kept."""
        path = self.value("trajectory")
        if not path:
            raise InputError("parameter trajectory = '': name an excitation.yaml or a validation motion to play")
        loaded = load_motion(path)
        loaded.check_robot(robot)
        once = Playback(loaded, robot, 1) if isinstance(loaded, Excitation) else loaded
        margins = certify(once, robot)
        if not margins.kept:
            raise InputError(f"{path}: not certified for robot {robot.name}: {margins.violations[0]}")
        for text in margins.unknown:
            self.get_logger().warning(f"not checked: {text}")
        motion: Reference = Playback(loaded, robot, self.value("periods")) if isinstance(loaded, Excitation) else loaded
        rehearsals = tuple(Slowed(once, speed) for speed in self.value("rehearsal") if speed > 0.0)
        if self.value("speed") < 1.0:
            motion = Slowed(motion, self.value("speed"))
        usual = loaded.sample_rate if isinstance(loaded, Excitation) else _USUAL_RATE
        return motion, rehearsals, self.value("rate") or usual

    def _make_output(self) -> Output:
        """Return the way to the robot that was asked for."""
        if self.value("output") == "joint_state":
            return SampleOutput(self, self._robot.joints, self.value("depth"))
        controller = self.value("controller")
        if not controller:
            raise InputError("parameter controller = '': output joint_trajectory needs the name of the controller")
        return TrajectoryOutput(
            self, self._robot.joints, self.value("depth"), controller, lambda motion: stop_from(motion, self._robot)
        )

    def _bounds(self) -> Bounds:
        share = self.value("effort_limit") or np.inf
        tracking = np.array(self.per_joint("tracking_error", self._robot.joints))
        return Bounds(self.value("state_timeout"), tracking, share * self._robot.limits.torque)

    # --- the robot

    def _on_state(self, message: JointState) -> None:
        self._watch.update(message.name, message.position, message.effort, stamp_of(message), time.monotonic())

    def _tick(self, number: int) -> None:
        """Send one command; in the ticker's thread."""
        t = number * self._ticker.interval
        command = self._player.tick(t, time.monotonic())
        self._output.send(self._player, command, t, lambda: self._stamp(number))
        if self._ending and not self._player.moving:
            self.end()

    def _stamp(self, number: int) -> int:
        """Return the instant [ns] for which a command is meant: on an even grid, however late it is sent."""
        since = round(number * self._ticker.interval * 1e9)
        if self._origin_ns is None:
            self._origin_ns = self.now_ns() - since
        return self._origin_ns + since

    def _on_stall(self, stall: Stall) -> None:
        self._origin_ns = None
        if stall.clock_jump and self._player.moving:
            self._player.stop(str(stall), fault=True)
        else:
            self._player.halt(str(stall))
            self._watch.forget()

    # --- start and stop

    def _start(self) -> str:
        """Begin to wait for the robot; return why that can't be, or an empty text."""
        problem = self._player.start()
        if not problem:
            self._preparing = threading.Thread(target=self._prepare, name="prepare", daemon=True)
            self._preparing.start()
        return problem

    def _prepare(self) -> None:
        """Wait for the robot and plan the approach; in a thread of its own."""
        deadline = time.monotonic() + self.value("state_wait")
        while self._player.phase is Phase.PREPARING:
            problem = self._watch.not_ready(time.monotonic()) or self._neighbours.not_heard()
            problem = problem or self._unheld() or self._rival()
            if not problem:
                break
            if time.monotonic() > deadline:
                self._player.cancel()
                return self._refuse(f"not started within {self.value('state_wait'):g} s: {problem}")
            if self._end.wait(0.05):
                return None
        try:
            if self._player.phase is Phase.PREPARING:
                self._player.prepare()
        except RobotIdentError as error:
            self._refuse(str(error))
        return None

    def _refuse(self, text: str) -> None:
        self._player.reason, self._player.fault = text, True
        if self.value("exit_when_done"):
            self.fail(InputError(text))
        else:
            self.get_logger().error(text)

    def _rival(self) -> str:
        """Return who else commands the robot, or an empty text."""
        return self._neighbours.rival() if self.value("exclusive") else ""

    def _unheld(self) -> str:
        """Return why nothing would hold the robot when commands stop, or an empty text."""
        if self.value("controller") or self._neighbours.simulated():
            return ""
        return (
            "parameter controller = '': on hardware, name the controller that holds the robot by itself when commands"
            " stop"
        )

    def _judge(self, number: int) -> str:
        """Return why nothing may follow a rehearsal, or an empty text."""
        share, joint, what = self._watch.worst_share()
        speed = self._rehearsals[number].speed
        text = f"rehearsal at {speed:.0%} used {share:.0%} of the bound on the {what} of {joint}"
        if share <= self.value("rehearsal_margin"):
            self.get_logger().info(text)
            return ""
        return f"{text} (rehearsal_margin {self.value('rehearsal_margin'):g})"

    def _on_speed_scaling(self, message: Float64) -> None:
        if not any(abs(message.data - full) <= 1e-3 * full for full in (1.0, 100.0)):
            self._player.stop(f"the robot's speed scaling is {message.data:g}", fault=True)

    def _on_start(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        problem = self._start()
        response.success, response.message = not problem, problem or "approaching as soon as the robot is there"
        return response

    def _on_stop(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        moving = self._player.moving or self._player.phase is Phase.PREPARING
        self._player.stop("stopped by ~/stop")
        response.success, response.message = moving, "stopping" if moving else "nothing moves"
        return response

    def request_end(self, reason: str) -> None:
        """Bring the robot to rest, then end."""
        self._player.stop(f"stopped by {reason}")
        if self._player.moving:
            self._ending = time.monotonic()
        else:
            self.end()

    # --- status

    def _look(self) -> None:
        """Tell each change of phase; end the node where it is to end."""
        player = self._player
        if player.moving and (rival := self._rival()):
            player.stop(rival, fault=True)
        if player.phase is not self._told:
            self._told, self._resting = player.phase, time.monotonic()
            text = f"{player.phase.value}{f': {player.reason}' if player.reason else ''}"
            if player.fault:
                self.get_logger().error(text)
            else:
                self.get_logger().info(text)
            self._tell()
        if self._ending and time.monotonic() - self._ending > _LONGEST_STOP:
            self.end()
        given_up = player.phase is Phase.IDLE and bool(player.reason)
        finished = given_up or player.phase in (Phase.HOLDING, Phase.HALTED)
        held = time.monotonic() - self._resting >= self.value("hold_time")
        if finished and held and self.value("exit_when_done"):
            if player.fault:
                self.fail(CheckFailed(player.reason))
            self.end()

    def _tell(self) -> None:
        player, timing = self._player, self._ticker.timing
        level = ERROR if player.fault else WARN if timing.missed else OK
        text = progress(player) + (f": {player.reason}" if player.reason else "")
        worst = self._watch.worst_tracking
        values: dict[str, object] = {
            "completed": player.completed,
            "ticks": timing.ticks,
            "missed ticks": timing.missed,
            "worst lateness [ms]": f"{1e3 * timing.worst:.2f}",
        }
        values |= {f"worst tracking {joint}": f"{worst[k]:.5f}" for k, joint in enumerate(self._robot.joints)}
        self._status.publish(self.status_array(level, text, values))

    def close(self) -> None:
        """Join the threads."""
        self.end()
        self._ticker.stop()
        if self._preparing is not None:
            self._preparing.join(1.0)
        timing = self._ticker.timing
        worst = f"worst lateness {1e3 * timing.worst:.2f} ms"
        self.get_logger().info(f"{timing.ticks} ticks, {timing.missed} missed, {worst}")


def main(argv: Sequence[str] | None = None) -> int:
    """Run the trajectory publisher."""
    return run(TrajectoryPublisher, argv)


if __name__ == "__main__":
    raise SystemExit(main())

"""Plays a trajectory on a robot: approach, periods, hold, and a smooth stop whenever something is wrong."""

from __future__ import annotations

import time
from functools import partial
from typing import ClassVar

from rcl_interfaces.msg import SetParametersResult
from rclpy.parameter import Parameter as RosParameter
from rclpy.task import Future
from std_srvs.srv import Trigger

from robot_ident.errors import CheckFailed, InputError
from robot_ident.limits.certifier import not_checked, unchecked_refusal
from robot_ident.nodes.lifecycle import MANAGED, ManagedNode, transition
from robot_ident.nodes.node import ERROR, OK, THREAD_PRIORITY, WARN, run
from robot_ident.nodes.outputs import OUTPUTS
from robot_ident.nodes.parameters import Parameter, live, until_configured
from robot_ident.nodes.playback_controller import Session
from robot_ident.playback.periodic_timer import Timing
from robot_ident.playback.plan import load_plan, progress
from robot_ident.playback.player import Phase, Player
from robot_ident.robot import load_robot

TABLE: tuple[Parameter, ...] = (
    until_configured("robot", "kuka_ir361", "name of a robot, a robot YAML or a URDF"),
    until_configured("trajectory", "", "excitation.yaml or validation motion to play"),
    until_configured("periods", 16, "steady periods to play, after one transient period", 1, 100_000),
    until_configured("rate", 0.0, "rate of the commands; 0: the sample rate of the trajectory", 0.0, 2000.0, unit="Hz"),
    until_configured("speed", 1.0, "share of the designed speed at which all is played", 0.01, 1.0),
    until_configured(
        "rehearsal",
        [0.0],
        "shares of the designed speed at which one period is played first, as [0.1, 0.3] (0: none); the next"
        " follows only where tracking error and effort stayed within rehearsal_margin of their bounds",
        0.0,
        1.0,
    ),
    Parameter("rehearsal_margin", 0.7, "share of its bounds that a rehearsal may use", 0.01, 1.0),
    until_configured(
        "output", "joint_state", "; ".join(f"{k}: {v}" for k, v in OUTPUTS.items()), choices=tuple(OUTPUTS)
    ),
    until_configured(
        "controller",
        "",
        "name of the robot's controller, which must hold by itself when commands stop; without one only a"
        " simulated robot is moved",
    ),
    until_configured(
        "speed_scaling_topic",
        "",
        "topic (std_msgs/Float64) on which the robot tells its speed scaling: a start waits for full speed, 1 or 100,"
        " and anything else stops the motion ('' for none)",
    ),
    until_configured(
        "accept_unchecked", False, "play a motion although limits or surroundings could not be checked, which are named"
    ),
    Parameter("autostart", False, "start as soon as the robot is there; otherwise by ~/start"),
    MANAGED,
    Parameter("exit_when_done", False, "end the node after the motion (exit code 3 where it was stopped for a reason)"),
    Parameter(
        "hold_time",
        0.5,
        "how long the last position is held before exit_when_done ends the node",
        0.0,
        3600.0,
        unit="s",
    ),
    live("state_wait", 30.0, "how long the robot's state is waited for at the start", 0.1, 3600.0, unit="s"),
    live("state_timeout", 0.25, "stop when no new joint state comes for so long", 0.01, 10.0, unit="s"),
    live(
        "tracking_error",
        [0.1],
        "stop when a joint is so far from where it was sent within 0.15 s; one value, or one a joint",
        1e-6,
        10.0,
        unit="rad or m",
    ),
    live(
        "effort_limit",
        1.25,
        "stop beyond so many times the robot's torque limit, or the current limit of a drive of unknown Nm/A; 0: never",
        0.0,
        100.0,
    ),
    live("exclusive", True, "stop when another node publishes on joint_command as well"),
    Parameter(
        "stall", 0.2, "command nothing more when this process stood still for so long in a motion", 0.01, 10.0, unit="s"
    ),
    Parameter("depth", 100, "commands that a slow reader may leave waiting", 1, 10_000),
    THREAD_PRIORITY,
)


_LATE = 2.0  # s that an end waits for a smooth stop beyond the time that it takes
_POLL = 0.01  # s
_UNTOLD = (Phase.IDLE, "", False)


class TrajectoryPublisher(ManagedNode):
    """Sends position and velocity of a certified trajectory; the phases are those of `Player`.

    configure: load and certify; activate: allow to start; deactivate: stop smoothly, then command nothing; cleanup:
    forget, so that another trajectory can be set and configured.
    """

    node_name: ClassVar[str] = "trajectory_publisher"
    description: ClassVar[str] = "plays an excitation or a validation motion on a robot, within its limits"
    table: ClassVar[tuple[Parameter, ...]] = TABLE

    def __init__(self) -> None:
        """Configure and activate, unless `managed`; InputError when the trajectory isn't safe for this robot."""
        super().__init__()
        self._session: Session | None = None
        self._told = _UNTOLD
        self._resting = 0.0
        self._ending = 0.0
        self._rest: tuple[Future, float] | None = None
        self.create_service(Trigger, "~/start", self._on_start)
        self.create_service(Trigger, "~/stop", self._on_stop)
        self.every(0.1, self._look)
        self.every(0.5, self._tell)
        self.add_on_set_parameters_callback(self._check_bounds)
        self.add_post_set_parameters_callback(lambda changes: self._session and self._session.renew_bounds())
        self.begin()

    # --- life

    @transition
    def on_configure(self) -> None:
        """Load and certify the trajectory, and begin to listen to the robot."""
        robot = load_robot(self.value("robot"))
        path = self.value("trajectory")
        if not path:
            raise InputError("parameter trajectory = '': name an excitation.yaml or a validation motion to play")
        plan = load_plan(
            path, robot, periods=self.value("periods"), speed=self.value("speed"), rehearsals=self.value("rehearsal")
        )
        if plan.unchecked and not self.value("accept_unchecked"):
            raise CheckFailed(f"{path}: {unchecked_refusal(plan.unchecked, 'set accept_unchecked:=true')}")
        if plan.unchecked:
            self.get_logger().warning(not_checked(plan.unchecked))
        self._session = Session(self, plan, self._refuse)
        for text in self._session.warnings:
            self.get_logger().warning(text)

    @transition
    def on_activate(self) -> None:
        """Allow to start; `autostart` does so."""
        assert self._session is not None
        self.get_logger().warning(
            "this is no safety function: keep the emergency stop at hand, and see that the robot's controller holds"
            " by itself when commands stop"
        )
        self._told = _UNTOLD
        self._session.activate()
        if self.value("autostart"):
            self._session.start()

    async def come_to_rest(self) -> None:
        """Stop smoothly; meanwhile the node goes on, and hears the clock."""
        if self._session is not None:
            self._session.player.stop("deactivated")
            rest = Future(executor=self.executor)
            self._rest = rest, time.monotonic()
            await rest

    @transition
    def on_deactivate(self) -> None:
        """Command nothing any more."""
        if self._session is not None:
            self._session.deactivate()
        self._rest = None

    @transition
    def on_cleanup(self) -> None:
        """Forget the trajectory."""
        if self._session is not None:
            self._session.close()
        self._session = None

    def _refuse(self, text: str) -> None:
        if self.value("exit_when_done"):
            self.fail(InputError(text))

    def _check_bounds(self, changes: list[RosParameter]) -> SetParametersResult:
        """Refuse bounds of another number of joints: the watch would be left without."""
        given = [len(change.value) for change in changes if change.name == "tracking_error"]
        joints = self._session.plan.robot.n if self._session else 0
        wrong = bool(given) and bool(joints) and given[-1] not in (1, joints)
        reason = f"tracking_error has {given[-1]} values; give one, or one for each of {joints} joints" if wrong else ""
        return SetParametersResult(successful=not wrong, reason=reason)

    # --- services

    def _on_start(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if self._session is None or self.state_label != "active":
            response.success, response.message = False, f"the node is {self.state_label}: activate it first"
            return response
        problem = "about to be deactivated" if self._rest is not None else self._session.start()
        response.success, response.message = not problem, problem or "approaching as soon as the robot is there"
        return response

    def _on_stop(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        player = self._session.player if self._session else None
        moving = player is not None and (player.moving or player.phase is Phase.PREPARING)
        if player is not None:
            player.stop("stopped by ~/stop")
        response.success, response.message = moving, "stopping" if moving else "nothing moves"
        return response

    def request_end(self, reason: str) -> None:
        """Bring the robot to rest, then end."""
        if self._session is not None:
            self._session.player.stop(f"stopped by {reason}")
        if self._session is not None and self._session.moving:
            self._ending = self._ending or time.monotonic()
        elif self._session is not None:
            self._finish(self._session.player)
        else:
            self.end()

    # --- status

    def _look(self) -> None:
        """Tell each change of phase or of its reason; end the node where it is to end."""
        session = self._session
        if session is None:
            return
        player = session.player
        if player.moving and (rival := session.rival()):
            player.stop(rival, fault=True)
        state = player.state
        if state != self._told:
            phase, reason, fault = state
            if phase is Phase.HALTED is not self._told[0]:
                session.output.forget()
            self._told, self._resting = state, time.monotonic()
            text = f"{phase.value}{f': {reason}' if reason else ''}"
            if fault:
                self.get_logger().error(text)
            else:
                self.get_logger().info(text)
            self._tell()
        self._look_for_the_end(session)

    def _look_for_the_end(self, session: Session) -> None:
        player = session.player
        if self._rest is not None and not self._rest[0].done() and self._rested(session, self._rest[1]):
            self._rest[0].set_result(None)
        if self._ending and self._rested(session, self._ending):
            self._finish(player)
        given_up = player.phase is Phase.IDLE and bool(player.reason)
        finished = given_up or player.phase in (Phase.HOLDING, Phase.HALTED)
        held = time.monotonic() - self._resting >= self.value("hold_time")
        if finished and held and self.value("exit_when_done"):
            self._finish(player)

    def _finish(self, player: Player) -> None:
        """End the node; with exit code 3 where a fault has stopped the motion that it was to end with."""
        if player.fault and self.value("exit_when_done"):
            self.fail(CheckFailed(player.reason))
        self.end()

    def _rested(self, session: Session, since: float) -> bool:
        return not session.moving or time.monotonic() - since > _LATE + session.player.stop_duration

    def _tell(self) -> None:
        session = self._session
        if session is None:
            self.tell(OK, self.state_label, {})
            return
        player, timing = session.player, session.ticker.timing
        level = ERROR if player.fault else WARN if timing.missed else OK
        text = progress(player) + (f": {player.reason}" if player.reason else "")
        values: dict[str, object] = {
            "state": self.state_label,
            "completed": player.completed,
            "ticks": timing.ticks,
            "missed ticks": timing.missed,
            "stalls": timing.stalls,
            "worst lateness [ms]": f"{1e3 * timing.worst:.2f}",
        }
        worst = session.watch.worst_tracking
        values |= {f"worst tracking {joint}": f"{worst[k]:.5f}" for k, joint in enumerate(session.plan.robot.joints)}
        self.tell(level, text, values)

    def close(self) -> None:
        """Bring the robot to rest whatever has ended the node (a bug, too), and join the threads."""
        self.end()
        timing = Timing()
        if self._session is not None:
            self._session.player.stop("the node ends")
            since = time.monotonic()
            while not self._rested(self._session, since):
                self.take_messages()  # of /clock, too, or time would stand still
                time.sleep(_POLL)
            self._session.end()
            timing = self._session.ticker.timing
        worst = f"worst lateness {1e3 * timing.worst:.2f} ms"
        self.get_logger().info(f"{timing.ticks} ticks, {timing.missed} missed, {worst}")


main = partial(run, TrajectoryPublisher)

if __name__ == "__main__":
    raise SystemExit(main())

"""A certified plan, the robot that it is for, and what plays it: made when the publisher is configured."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

import numpy as np
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64

from robot_ident.errors import InputError, RobotIdentError
from robot_ident.limits.certifier import Certifier
from robot_ident.nodes.effort_topics import EffortTopics, sources_of
from robot_ident.nodes.messages import stamp_of
from robot_ident.nodes.node import BaseNode, reliable
from robot_ident.nodes.outputs import ActionOutput, Output, SampleOutput, TrajectoryOutput
from robot_ident.nodes.subscriptions import hear
from robot_ident.planning.approach import NotWanted, approach
from robot_ident.planning.stop import stop_from
from robot_ident.playback.periodic_timer import Stall, Ticker
from robot_ident.playback.plan import Plan
from robot_ident.playback.player import DWELL, Phase, Player
from robot_ident.playback.stamps import SetClock
from robot_ident.playback.supervisor import Bounds, EffortLoad, SpeedScaling, Watch
from robot_ident.signals.motion import Array, Motion
from robot_ident.trajectories.excitation import Reference

_DEPTH = 100  # joint states that may wait to be looked at
_LEFT_OUT = 3  # ticks that may be left out between two commands, however tight the bound on tracking
_SILENT = 1.0  # s after which a topic of efforts counts as silent
_ATTEMPTS = 5  # approaches that are planned for a start: the robot may be moved while one is
_STOOD = 0.05  # s of real time between two ticks of simulated time, beyond which that time has stood still


class Session:
    """Listens to the robot from the start on; from `activate` to `deactivate` it can play, in a thread of its own."""

    def __init__(self, node: BaseNode, plan: Plan, refuse: Callable[[str], None]) -> None:
        """Subscribe and make the way to the robot; refuse(text) is told why a start came to nothing."""
        self._node, self.plan, self._refuse = node, plan, refuse
        self._joints = plan.robot.joints
        # one for each thread that plans, and neither is left anything to make
        self._for_approach, self._for_stops = (Certifier(plan.robot).prepare() for _ in range(2))
        self._simulated: bool = node.get_parameter("use_sim_time").value
        self.output = self._make_output()
        self._load = EffortLoad(plan.robot)
        sources = sources_of(plan.robot, node)
        self._beside = {joint: one.field for joint, one in sources.items() if one.topic is None}
        self.watch = Watch(
            self._joints, self._bounds(), convert=self._load.of, units=self._load.units, elsewhere=tuple(sources)
        )
        self._clock = SetClock(node.now_ns)
        self._scaling = SpeedScaling(node.value("speed_scaling_topic"))
        self._efforts = EffortTopics(
            node, plan.robot, sources, lambda one: self.watch.update_efforts(one.values, time.monotonic()), _DEPTH
        )
        self._hearings = [hear(node, JointState, "joint_states", self._on_state, reliable(_DEPTH))]
        if topic := node.value("speed_scaling_topic"):
            self._hearings.append(hear(node, Float64, topic, self._on_speed_scaling, reliable(10)))
        self._preparing: threading.Thread | None = None
        self._origin_ns: int | None = None
        self._ticked = time.monotonic()
        self.player, self.ticker = self._make_player()

    def _plan_approach(self, q: Array) -> Reference:
        return approach(
            q,
            self.plan.motion.start_pose,
            self.plan.robot,
            certifier=self._for_approach,
            wanted=lambda: self.player.phase is Phase.PREPARING,
        )

    def _plan_stop(self, motion: Motion) -> Reference:
        return stop_from(motion, self.plan.robot, self._for_stops)

    def _make_output(self) -> Output:
        """Return the way to the robot that was asked for; InputError where commands would come too rarely for it."""
        node, name, controller = self._node, self._node.value("output"), self._node.value("controller")
        kinds: dict[str, type[Output]] = {"joint_state": SampleOutput, "joint_trajectory": TrajectoryOutput}
        every = kinds.get(name, ActionOutput).every
        if self._rate * every < 1.0:
            raise InputError(f"parameter rate = {self._rate:g}: output {name} needs {1.0 / every:g} Hz or more")
        if name == "joint_state":
            return SampleOutput(node, self._joints, node.value("depth"))
        if not controller:
            raise InputError(f"parameter controller = '': output {name} needs the name of the controller")
        if name == "joint_trajectory":
            return TrajectoryOutput(node, self._joints, node.value("depth"), controller, self._plan_stop)
        return ActionOutput(node, self._joints, controller, self._plan_stop, lambda text: self.player.halt(text))

    @property
    def _rate(self) -> float:
        return float(self._node.value("rate")) or self.plan.rate

    def _make_player(self) -> tuple[Player, Ticker]:
        plan, lead = self.plan, self.output.lead
        player = Player(
            plan.motion,
            self._plan_approach,
            self._plan_stop,
            self.watch,
            rehearsals=plan.rehearsals,
            judge=self._judge,
            hindrance=lambda: self._scaling.problem,
            lead=lead,
            dwell=DWELL + 5 * lead,
            longest_step=np.inf if lead else _LEFT_OUT * plan.robot.limits.velocity / self._rate,
        )
        simulated = self._simulated
        ticker = Ticker(
            self._rate,
            self._tick,
            # a simulated robot waits for what is late, a real one has moved on
            late="catch_up" if simulated else "skip",
            stall=min(1.0 if simulated else self._node.value("stall"), self.output.longest_stall),
            on_stall=self._on_stall,
            on_error=self._node.fail,
            clock=(lambda: self._node.now_ns() * 1e-9) if simulated else None,
            priority=self._node.tick_priority(),
        )
        return player, ticker

    # --- life

    def activate(self) -> None:
        """Begin to tick; nothing moves before `start`."""
        self.watch.forget()
        self.ticker.start()

    def deactivate(self) -> None:
        """Command nothing any more; a later `activate` begins with a player that knows no past."""
        self.end()
        self._origin_ns = None
        self.player, self.ticker = self._make_player()

    def end(self) -> None:
        """Join the threads: nothing of the node may be destroyed under one that uses it."""
        self.player.cancel()
        self.ticker.stop()
        if self._preparing is not None:
            self._preparing.join()

    @property
    def moving(self) -> bool:
        """Whether the robot is being moved: a player whose ticker has ended moves nothing."""
        return self.player.moving and self.ticker.running

    def close(self) -> None:
        """Give back what was taken of the node."""
        self._efforts.close()
        self.output.close()
        for hearing in self._hearings:
            hearing.end()

    def renew_bounds(self) -> None:
        """Take the bounds of the watch from the parameters, which may be changed at any time."""
        self.watch.bounds = self._bounds()

    def _bounds(self) -> Bounds:
        node, robot = self._node, self.plan.robot
        share = node.value("effort_limit") or np.inf
        tracking = np.array(node.per_joint("tracking_error", robot.joints))
        timeout = node.value("state_timeout")
        return Bounds(
            timeout if self._simulated else min(timeout, self.output.longest_silence),
            tracking,
            share * self._load.bounds,
        )

    # --- the robot

    @property
    def warnings(self) -> tuple[str, ...]:
        """What isn't watched, a line each."""
        lines: list[str] = []
        timeout, longest = self._node.value("state_timeout"), self.output.longest_silence
        if timeout > longest and not self._simulated:
            lines.append(
                f"state_timeout {timeout:g} s counts as {longest:g} s: after that the controller begins to stop by"
                " itself, and what reached it later would lead it back in a leap"
            )
        if not self._node.value("effort_limit"):
            return (*lines, "efforts are not watched (effort_limit 0), and rehearsals judge tracking alone")
        return (*lines, *self._load.unwatched)

    def _on_state(self, message: JointState) -> None:
        now, names = time.monotonic(), list(message.name)
        for joint, field in self._beside.items():
            values = getattr(message, field)
            if joint in names and len(values) == len(names):
                self.watch.update_efforts({joint: values[names.index(joint)]}, now)
        self.watch.update(names, message.position, message.effort, stamp_of(message), now)

    def _on_speed_scaling(self, message: Float64) -> None:
        self._scaling.update(message.data)
        if self._scaling.problem:
            self.player.interrupt(self._scaling.problem)

    def _tick(self, number: int) -> None:
        """Send one command; in the ticker's thread."""
        t, now = number * self.ticker.interval, time.monotonic()
        stood = now - self._ticked - self.ticker.interval
        if self._simulated and stood > _STOOD:  # the clock did: one that is stopped, or waits for a loaded machine
            self.watch.excuse(stood, now)
        self._ticked = now
        self._look_at_clock()
        command = self.player.tick(t, now)
        self.output.send(self.player, command, t, lambda: self._stamp(number))

    def _stamp(self, number: int) -> int:
        """Return the instant [ns] for which a command is meant: on an even grid, however late it is sent."""
        since = round(number * self.ticker.interval * 1e9)
        if self._origin_ns is None:
            self._origin_ns = self._node.now_ns() - since
        return self._origin_ns + since

    def _look_at_clock(self) -> None:
        """Stop where the machine's clock was set."""
        step = 0.0 if self._simulated else self._clock.step()
        if not step:
            return
        self._origin_ns = None
        jump = str(Stall(step, clock_jump=True))
        if self.output.lead:  # a controller goes by such a clock: what it was told is over, or yet to come
            self.player.halt(jump)
        else:
            self.player.interrupt(jump)

    def _on_stall(self, stall: Stall) -> None:
        self._origin_ns = None
        if stall.clock_jump and self.player.moving:
            self.player.stop(str(stall), fault=True)
        else:
            self.player.halt(str(stall))
            self.watch.forget()

    # --- start

    def start(self) -> str:
        """Begin to wait for the robot; return why that can't be, or an empty text."""
        if self._preparing is not None and self.player.phase is not Phase.PREPARING:
            self._preparing.join()  # of a start that was given up
        if self.player.phase in (Phase.IDLE, Phase.HALTED):
            self.watch.forget()  # a driver that was restarted may stamp its messages earlier than the one before
        problem = self.player.start()
        if not problem:
            self._preparing = threading.Thread(target=self._prepare, name="prepare", daemon=True)
            self._preparing.start()
        return problem

    def _prepare(self) -> None:
        """Wait for the robot and plan the approach; in a thread of its own."""
        player, wait = self.player, self._node.value("state_wait")
        deadline, planned = time.monotonic() + wait, 0
        try:
            while player.phase is Phase.PREPARING:  # until a tick begins what is planned, or somebody gives it up
                # also where this process stood still, or the robot was moved, after it had been planned
                if player.unplanned:
                    problem = self._unprepared()
                    if not problem and planned == _ATTEMPTS:
                        return self._give_up("the robot was moved or slowed whenever its approach had been planned")
                    if not problem:
                        self._tell_unheard()
                        player.prepare()
                        planned, deadline = planned + 1, time.monotonic() + wait
                    elif time.monotonic() > deadline:
                        return self._give_up(f"not started within {wait:g} s: {problem}")
                if self._node.wait_end(0.05):
                    return None
        except NotWanted:
            return None
        except RobotIdentError as error:
            self._give_up(str(error))
        except BaseException as error:
            self._node.fail(error)
            raise
        return None

    def _unprepared(self) -> str:
        """Return why no approach can be planned yet, or an empty text."""
        return (
            self.watch.not_ready(time.monotonic())
            or self.output.not_heard()
            or self._unheld()
            or self._scaling.problem
            or self.rival()
        )

    def _tell_unheard(self) -> None:
        """Say whose effort has a bound but is not reported."""
        unheard, why = self.watch.unheard, self._efforts.silent(_SILENT)
        if unheard:
            self._node.get_logger().warning(
                f"no effort of {', '.join(unheard)} is reported: it is not watched, and rehearsals judge tracking alone"
                f" there{f' ({why})' if why else ''}"
            )

    def _give_up(self, text: str) -> None:
        self.player.cancel()
        self._refuse(text)
        self.player.fault, self.player.reason = True, text

    def rival(self) -> str:
        """Return who else commands the robot, or an empty text."""
        return self.output.rival() if self._node.value("exclusive") else ""

    def _unheld(self) -> str:
        """Return why nothing would hold the robot when commands stop, or an empty text."""
        if self._node.value("controller") or self.output.simulated():
            return ""
        return (
            "parameter controller = '': on hardware, name the controller that holds the robot by itself when commands"
            " stop"
        )

    def _judge(self, number: int) -> str:
        """Return why nothing may follow a rehearsal, or an empty text."""
        share, joint, what = self.watch.worst_share()
        speed = self.plan.rehearsals[number].speed
        text = f"rehearsal at {speed:.0%} used {share:.0%} of the bound on the {what} of {joint}"
        margin = self._node.value("rehearsal_margin")
        if share <= margin:
            self._node.get_logger().info(text)
            return ""
        return f"{text} (rehearsal_margin {margin:g})"

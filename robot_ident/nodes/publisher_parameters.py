"""The parameters of the trajectory publisher."""

from __future__ import annotations

from robot_ident.nodes.common import THREAD_PRIORITY
from robot_ident.nodes.managed import MANAGED
from robot_ident.nodes.outputs import OUTPUTS
from robot_ident.nodes.parameters import Parameter

TABLE: tuple[Parameter, ...] = (
    Parameter("robot", "kuka_ir361", "name of a robot, a robot YAML or a URDF", until_configured=True),
    Parameter("trajectory", "", "excitation.yaml or validation motion to play", until_configured=True),
    Parameter("periods", 16, "steady periods to play, after one transient period", 1, 100_000, until_configured=True),
    Parameter(
        "rate",
        0.0,
        "rate of the commands; 0: the sample rate of the trajectory",
        0.0,
        2000.0,
        unit="Hz",
        until_configured=True,
    ),
    Parameter("speed", 1.0, "share of the designed speed at which all is played", 0.01, 1.0, until_configured=True),
    Parameter(
        "rehearsal",
        [0.0],
        "shares of the designed speed at which one period is played first, as [0.1, 0.3] (0: none); the next"
        " follows only where tracking error and effort stayed within rehearsal_margin of their bounds",
        0.0,
        1.0,
        until_configured=True,
    ),
    Parameter("rehearsal_margin", 0.7, "share of its bounds that a rehearsal may use", 0.01, 1.0),
    Parameter(
        "output",
        "joint_state",
        "; ".join(f"{k}: {v}" for k, v in OUTPUTS.items()),
        choices=tuple(OUTPUTS),
        until_configured=True,
    ),
    Parameter(
        "controller",
        "",
        "name of the robot's controller, which must hold by itself when commands stop; without one only a"
        " simulated robot is moved",
        until_configured=True,
    ),
    Parameter(
        "speed_scaling_topic",
        "",
        "topic (std_msgs/Float64) on which the robot tells its speed scaling: a start waits for full speed, 1 or 100,"
        " and anything else stops the motion ('' for none)",
        until_configured=True,
    ),
    Parameter(
        "accept_unchecked",
        False,
        "play a motion although limits or surroundings could not be checked, which are named",
        until_configured=True,
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
    Parameter(
        "state_wait",
        30.0,
        "how long the robot's state is waited for at the start",
        0.1,
        3600.0,
        unit="s",
        live=True,
    ),
    Parameter("state_timeout", 0.25, "stop when no new joint state comes for so long", 0.01, 10.0, unit="s", live=True),
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
        "effort_limit",
        1.25,
        "stop beyond so many times the robot's torque limit, or the current limit of a drive of unknown Nm/A; 0: never",
        0.0,
        100.0,
        live=True,
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
    Parameter("depth", 100, "commands that a slow reader may leave waiting", 1, 10_000),
    THREAD_PRIORITY,
)

"""Plays an excitation, records it and identifies the robot live: on hardware, or on the simulated robot.

ros2 launch robot_ident identify.launch.py trajectory:=excitation.yaml simulation:=true autostart:=true
"""

from __future__ import annotations

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, Shutdown
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

ARGUMENTS = {
    "trajectory": (None, "excitation.yaml or validation motion to play"),
    "robot": ("kuka_ir361_spring", "name of a robot, a robot YAML or a URDF"),
    "periods": ("16", "steady periods to play, after one transient period"),
    "speed": ("1.0", "share of the designed speed, for a rehearsal"),
    "output": (
        "joint_state",
        "joint_state on joint_command; joint_trajectory or follow_joint_trajectory for the controller",
    ),
    "controller": ("", "name of the robot's controller, which must hold by itself; needed on a real robot"),
    "managed": ("false", "true: the publisher waits for `ros2 lifecycle set` configure and activate"),
    "simulation": ("false", "true: start the simulated robot; false: the driver of a real one is running"),
    "autostart": ("false", "true: the robot MOVES as soon as it is there; false: by trajectory_publisher/start"),
    "accept_unchecked": ("false", "true: play although limits or surroundings could not be checked"),
    "bag": ("", "folder of the bag, made by the recorder (empty: a name from date and time)"),
    "model": ("", "model.yaml to write after the identification (empty: none)"),
    "config": (
        PathJoinSubstitution([FindPackageShare("robot_ident"), "config"]),
        "folder with one parameter file a node, as in the package's config folder",
    ),
    "namespace": ("", "namespace of all nodes and topics, for several robots on one network"),
    "joint_states": ("joint_states", "topic of the measured joint states"),
    "joint_command": ("joint_command", "topic of the commands"),
    "use_sim_time": ("false", "true: time comes from /clock"),
}
"""name: (default, description); None: must be given."""


def argument(name: str, kind: type) -> ParameterValue:
    """Return the value of a launch argument as a node's parameter of this type."""
    return ParameterValue(LaunchConfiguration(name), value_type=kind)


def node(name: str, **options: object) -> Node:
    """Return a node with its parameter file, and over it the arguments of this launch."""
    parameters = options.pop("parameters")
    assert isinstance(parameters, dict)
    return Node(
        package="robot_ident",
        executable=name,
        name=name,
        namespace=LaunchConfiguration("namespace"),
        output="screen",
        parameters=[
            PathJoinSubstitution([LaunchConfiguration("config"), f"{name}.yaml"]),
            parameters | {"use_sim_time": argument("use_sim_time", bool)},
        ],
        remappings=[(topic, LaunchConfiguration(topic)) for topic in ("joint_states", "joint_command")],
        **options,
    )


def generate_launch_description() -> LaunchDescription:
    """Return the arguments and the four nodes; all end when the publisher ends, so that the bag is closed properly."""
    robot, trajectory = argument("robot", str), argument("trajectory", str)
    return LaunchDescription(
        [
            *(
                DeclareLaunchArgument(name, default_value=default, description=description)
                for name, (default, description) in ARGUMENTS.items()
            ),
            node(
                "simulated_kuka",
                parameters={"robot": robot},
                condition=IfCondition(LaunchConfiguration("simulation")),
            ),
            node("recorder", parameters={"robot": robot, "output": argument("bag", str)}),
            node(
                "estimator",
                parameters={
                    "robot": robot,
                    "trajectory": trajectory,
                    "periods": argument("periods", int),
                    "output": argument("model", str),
                },
            ),
            node(
                "trajectory_publisher",
                parameters={
                    "robot": robot,
                    "trajectory": trajectory,
                    "periods": argument("periods", int),
                    "speed": argument("speed", float),
                    "accept_unchecked": argument("accept_unchecked", bool),
                    "autostart": argument("autostart", bool),
                    "managed": argument("managed", bool),
                    "output": argument("output", str),
                    "controller": argument("controller", str),
                },
                on_exit=Shutdown(reason="the trajectory publisher has ended"),
            ),
        ]
    )

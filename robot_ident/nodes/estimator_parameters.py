"""The parameters of the estimator."""

from __future__ import annotations

from robot_ident.estimation.solve import ESTIMATORS
from robot_ident.nodes.parameters import Parameter

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
    Parameter(
        "periods",
        0,
        "identify after so many steady periods; 0: when the periodic motion ends",
        0,
        100_000,
        live=True,
    ),
    Parameter(
        "each_period",
        True,
        "identify anew after every steady period from the third on, so that parameters and covariance are live; the"
        " last identification, at the end of the periods, is the one that output keeps",
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
    Parameter(
        "model", "", "model.yaml with which to predict, from the start or from when it is set ('' for none)", live=True
    ),
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

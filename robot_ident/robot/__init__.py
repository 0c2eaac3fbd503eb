"""Robots: the rigid arm, its limits, drives, noise and rules, read from URDF and YAML."""

from robot_ident.robot.load import load_robot
from robot_ident.robot.robot import Drives, Limits, Noise, Robot, Spring

__all__ = ["Drives", "Limits", "Noise", "Robot", "Spring", "load_robot"]

"""Robots: the rigid arm, its limits, drives, noise and rules, read from URDF and YAML."""

from robot_ident.robot.robot import Drives, Limits, Noise, Robot, Spring
from robot_ident.robot.robot_file import load_robot

__all__ = ["Drives", "Limits", "Noise", "Robot", "Spring", "load_robot"]

"""Simulation: the robot that stands in for the hardware, faster than real time or step by step."""

"""Optimal excitation: the motion within a robot's limits that tells most of its parameters, and how good any can be."""

"""Certificates over continuous time that a motion keeps a robot's limits, its workspace, and its links apart."""

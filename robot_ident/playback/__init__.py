"""Real time without ROS: deadlines, the phases of a motion that is played, and what watches the robot meanwhile."""

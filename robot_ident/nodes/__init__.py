"""The ROS 2 nodes: each reads its parameters, builds a core object, converts messages and calls it."""

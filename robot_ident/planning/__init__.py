"""Ways into a motion, out of it and between poses, within the limits."""

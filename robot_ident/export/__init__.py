"""An identified model in the formats of others: URDF, MJCF, C code."""

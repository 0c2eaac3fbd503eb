"""robot_ident: optimal excitation of robots, identification with uncertainty, and doubt about what the model lacks."""

__version__ = "0.1.0"

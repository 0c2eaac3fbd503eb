"""What was measured: a recording on its clock, its periods averaged, velocity and acceleration, the noise without a
model.
"""

from robot_ident.recording.measurement import Measurement, Processing
from robot_ident.recording.process import process
from robot_ident.recording.recording import Recording

__all__ = ["Measurement", "Processing", "Recording", "process"]

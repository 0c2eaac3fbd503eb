"""The simulated robot that stands in for the hardware, and what is tried on it: trials with hidden effects, Monte
Carlo.
"""

from __future__ import annotations

"""Excitation: periodic trajectories, their limits certified in continuous time, and their optimal design.

`Excitation` is the file; `design` finds the best one, `certify` proves its limits, `Playback`, `approach` and
`validation_motion` give the motions that are played (`Reference`), `evaluate` says what they tell about the parameters.
"""

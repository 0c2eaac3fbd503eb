"""Motions as functions of time: Fourier series, the excitation file, moves from point to point."""

"""Swevers et al. (1997), "Optimal Robot Excitation and Identification", computed again: every figure beside the printed
one.
"""

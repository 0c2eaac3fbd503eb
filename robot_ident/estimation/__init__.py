"""Estimation: parameters with their uncertainty, validation on another motion, Monte Carlo."""

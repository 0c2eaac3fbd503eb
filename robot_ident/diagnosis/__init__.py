"""Doubt: does the model fit, where does it fail, and which physical effect is missing?"""

"""Figures: one file a figure, each a function from core objects to a plotly figure; plotly itself comes late."""

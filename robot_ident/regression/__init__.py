"""Rows in units of their noise, the columns of a model on them, its fit, and whether it leaves more than noise."""

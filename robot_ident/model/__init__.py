"""Models: base parameters, columns with names, and estimated values with their uncertainty."""

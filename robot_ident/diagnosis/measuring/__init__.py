"""Faults of what is measured, recognised by tests of their own before any physics is doubted."""

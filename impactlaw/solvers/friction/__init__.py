"""Solvers of the problem with friction: one cone per contact."""

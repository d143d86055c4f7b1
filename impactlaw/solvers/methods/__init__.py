"""Solvers of the frictionless problem, one file each."""

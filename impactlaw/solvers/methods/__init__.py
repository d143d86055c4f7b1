"""Solvers of the frictionless problem, one per file."""

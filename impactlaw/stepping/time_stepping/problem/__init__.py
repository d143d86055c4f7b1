"""The problem of a step: rows, targets, and its solution."""

"""Rows, blocks and systems of the cone problem, compiled."""

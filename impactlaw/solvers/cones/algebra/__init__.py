"""Compiled linear algebra of the cone problem: rows, blocks and systems."""

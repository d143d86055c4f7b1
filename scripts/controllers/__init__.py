"""Scripted controllers of the environments."""

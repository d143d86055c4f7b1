"""Recordings of environments: which episodes, how their environment was made, and going through one again."""

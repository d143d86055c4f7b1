"""Policies of studies: scripted, of the user's own, from a file, or trained."""

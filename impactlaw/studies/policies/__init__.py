"""Policies of studies: scripted, written by the user, read from a file, or trained."""

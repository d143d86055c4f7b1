"""Soft stepping in compiled code."""

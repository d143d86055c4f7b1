"""Contacts that take no part in a step, and the equality constraints that keep them from it."""

"""Contacts that stay closed."""

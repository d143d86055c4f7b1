"""Contacts that take no part in a step."""

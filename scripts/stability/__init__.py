"""Extreme and stiff cases, each with its verdict."""

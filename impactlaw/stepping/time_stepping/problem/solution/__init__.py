"""Impulses of the problem of a step: solved, restitution scaled, and what contacts do made of them."""

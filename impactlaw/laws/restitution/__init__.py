"""Restitution as users write it: one number, by contact, in MJCF, as plain values."""

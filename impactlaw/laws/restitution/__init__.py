"""Restitution as it is written: by number, by contact, in MJCF, as plain values."""

"""Shared parts of compiled steps: MuJoCo's structures and functions, whitening, and the coefficients of a law."""

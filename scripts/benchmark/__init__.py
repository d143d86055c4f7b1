"""Benchmarks: what laws, steps and the import cost."""

"""Benchmarks: run time of laws, steps, environments and the import."""

"""Studies and measurements of impactlaw: each package runs as ``python -m scripts.<name>``."""

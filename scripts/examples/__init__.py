"""Examples of at most 40 lines each: ``python -m scripts.examples.newtons_cradle``."""

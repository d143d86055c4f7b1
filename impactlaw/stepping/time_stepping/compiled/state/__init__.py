"""The state of a world in compiled steps: addresses of its arrays, its memory, and how a step has ended."""

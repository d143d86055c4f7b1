"""Random collisions, with friction and without."""

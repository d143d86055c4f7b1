"""Collisions, impacts and the set of possible right-velocities: the mathematics, without MuJoCo."""

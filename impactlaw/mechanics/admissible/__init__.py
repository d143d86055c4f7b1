"""The set S(v-) of possible right-velocities."""

"""A law in the place where somebody else's environment steps MuJoCo."""

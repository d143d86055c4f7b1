"""Reading of compiled scenes and their state: the only package that knows MuJoCo's arrays."""

"""What a compiled scene and its state say: the only place that knows MuJoCo's arrays."""

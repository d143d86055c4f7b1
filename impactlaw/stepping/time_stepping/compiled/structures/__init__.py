"""MuJoCo's structures and functions as compiled code sees them."""

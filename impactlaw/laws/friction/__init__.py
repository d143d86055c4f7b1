"""Laws with friction."""

"""Hold contacts that stay closed."""

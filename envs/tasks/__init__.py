"""Tasks whose outcome depends on the impact law."""

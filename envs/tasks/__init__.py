"""Tasks in which the impact law decides."""

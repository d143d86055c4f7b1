"""The frames of a recording, and its file."""

"""What a recording writes: its frames, and its file."""

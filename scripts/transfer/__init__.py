"""What it costs to act under another law than the one that was trained under."""

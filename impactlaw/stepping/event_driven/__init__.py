"""Event-driven stepping."""

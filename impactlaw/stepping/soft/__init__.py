"""Soft stepping: MuJoCo keeps contact, the law takes over collisions."""

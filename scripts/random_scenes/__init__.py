"""Random scenes, and piles in a bin."""

"""Find when gaps close, and how far bodies travel meanwhile."""

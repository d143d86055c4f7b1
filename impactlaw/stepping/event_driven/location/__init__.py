"""When gaps close, and how far bodies travel meanwhile."""

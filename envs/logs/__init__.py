"""Record episodes of environments and how these were made, and replay them."""

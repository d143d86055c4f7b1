"""Transfer of policies: the cost of acting under another law than the one used for training."""

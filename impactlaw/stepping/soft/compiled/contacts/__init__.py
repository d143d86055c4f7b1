"""Contacts and limits of compiled soft steps: which of them act, their rows, and the effect of equality constraints."""

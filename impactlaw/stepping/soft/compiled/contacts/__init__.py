"""Contacts and limits of compiled soft steps: which act, their rows, and what equality constraints leave of them."""

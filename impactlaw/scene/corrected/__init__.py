"""Contacts of MuJoCo that are corrected, or left out."""

"""Vectorized environments whose worlds form one batch, stepped under impact laws in MuJoCo's own threads."""

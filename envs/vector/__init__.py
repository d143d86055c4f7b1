"""Vectorized environments: all worlds of one batch, stepped in MuJoCo's own threads under impact laws."""

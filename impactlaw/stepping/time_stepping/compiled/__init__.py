"""Time stepping in compiled code, based on MuJoCo's C functions."""

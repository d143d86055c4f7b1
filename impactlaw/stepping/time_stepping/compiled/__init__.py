"""Time stepping in compiled code, over the C functions of MuJoCo."""

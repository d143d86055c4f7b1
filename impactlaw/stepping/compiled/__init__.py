"""What compiled steps share: MuJoCo's structures and functions, whitening, the coefficients of a law."""

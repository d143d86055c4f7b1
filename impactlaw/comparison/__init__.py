"""One scene under several laws and under MuJoCo's soft contacts."""

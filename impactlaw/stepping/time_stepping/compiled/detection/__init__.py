"""Which of MuJoCo's contacts take part in a step, and where they act."""

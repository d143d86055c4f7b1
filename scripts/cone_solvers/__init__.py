"""The study "cone solvers": contact problems with friction from time stepping, solved by our solver and by others."""

"""Solve the problem of a step for impulses, scale restitution, and derive what contacts do."""

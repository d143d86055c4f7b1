"""The ways in which a step in compiled code can end."""

UNDER_WAY = -1
"""It has not ended, except by an error."""
FINE = 0
HUGE_INPUT = 1
"""The state at the start is not finite, or huge."""
HUGE_OUTPUT = 2
"""Position or velocity is not finite, or huge, at the end."""
NOT_FINITE = 3
"""The forces are not finite."""
CREATES = 4
"""The law would create energy."""
UNKNOWN = 5
"""The restitution of a contact is not known yet."""
TIMESTEP = 6
"""The timestep is not positive, or not finite."""
CALLBACK = 7
"""One of MuJoCo's callbacks is set."""
UNSEEN = 8
"""A limit of a joint was left out that the step would pass."""
FARTHER = 9
"""A collision throws a body farther than contacts were looked for."""
OVERRIDDEN = 10
"""Contacts have friction, and MuJoCo's override of contacts is on."""
RAISED = 11
"""Something that is called in Python has raised an error."""

"""The numbers of the scheme."""

REST_SPEED = 0.1
"""Closing speed, m/s, above which a soft contact collides."""

ROUNDING = 1e-12
"""Part of the largest contact velocity up to which a contact does not separate: a collision with E = 0 leaves it so."""

OPENING = 0.1
"""Part of `rest_speed` up to which a contact does not separate either: soft contact at rest trembles."""

LOCKED = 1.0
"""Ratio of damping to inertia, h D / M, above which a joint has the inertia ``M + h D`` in a collision.

From 1 on, damping takes most of a velocity within a step. MuJoCo's contacts push against the whole of that force, of
which the step then takes only ``1 / (1 + h D / M)``: what is left of their push throws bodies apart."""

WORK = 200.0
"""Units of `work.Work` that the collisions of a step may take in Python, and those without restitution once more."""

UNDERDAMPED = 0.98
"""Square of the damping ratio below which MuJoCo's contact is a spring that throws back."""

STILL = 1e-9
"""Closing speed, m/s or rad/s, up to which a contact that a collision has stopped is at rest."""

GAINED = 0.02
"""Part of the energy of its jump that a collision may gain by the drift of equality constraints that it keeps."""

DRAGGED = 1.01
"""Ratio of the speed after a collision, in the kinetic metric, to the largest that one moving surface can give."""

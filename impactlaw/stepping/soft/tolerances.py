"""Numerical constants of soft stepping."""

REST_SPEED = 0.1
"""Closing speed, m/s, above which a soft contact collides, unless gravity gives more than this in a timestep."""

FALLS = 1.5
"""Closing speed above which a soft contact collides, relative to what gravity gives in a timestep.

A weight that the law has thrown up a little falls back within the timestep: below 1 it would not come to rest. Corners
of a body that tips fall faster."""

ROUNDING = 1e-12
"""Opening speed up to which a contact does not count as separating, relative to the largest contact velocity.

A collision with E = 0 leaves contacts with such speeds by rounding."""

OPENING = 0.1
"""Opening speed, relative to `rest_speed`, up to which a contact does not separate either: soft contact trembles."""

JUST_CLOSED = 2.0
"""Largest depth of a contact that has just closed, relative to the distance by which it closes in a timestep.

A deeper contact closed earlier, when the law left it to MuJoCo: bodies rest on it. The value 1 leaves out contacts of
feet that motors press down, too: 14 % of those of HalfCheetah then leave too fast, instead of 8 %."""

LOCKED = 1.0
"""Ratio of damping to inertia, h D / M, above which a joint has the inertia ``M + h D`` in a collision.

From 1 on, damping takes most of a velocity within a step. MuJoCo's contacts balance the whole damping force, of which
the step then takes only the part ``1 / (1 + h D / M)``; the rest of the contact force throws bodies apart."""

WORK = 200.0
"""Units of `work.Work` for the collisions of a step in Python, and again for the attempt without restitution."""

UNDERDAMPED = 0.98
"""Square of the damping ratio below which MuJoCo's contact counts as a spring that throws bodies back."""

STILL = 1e-9
"""Closing speed, m/s or rad/s, up to which a contact that a collision has stopped is at rest."""

GAINED = 0.02
"""Energy that the drift of equality constraints may add to a collision, relative to that of its velocity jump."""

DRAGGED = 1.01
"""Ratio of the speed after a collision, in the kinetic metric, to the largest that one moving surface can give."""

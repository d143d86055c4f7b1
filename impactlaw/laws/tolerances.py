"""Tolerances of the laws: name, value, unit, reason. Tolerances without a unit are ratios."""

INFLUENCE = 1e-12  # cosine of the angle between two gradients up to which their contacts do not influence each other
LOST = 1e-5  # shortfall of a contact velocity, relative to the speed, above which an impact is refused

# --- Poisson's expansion. ---------------------------------------------------------------------------------------------
KICK_ROUNDING = 2.0**-50  # relative to the speeds before and after the kick of the least impulses: smaller bounds are 0
JAMMED_PART = 1e-10  # length of a gradient after projection, relative to before, up to which it is rounding

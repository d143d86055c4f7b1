"""The tolerances of laws: name, value, unit, reason. Those without a unit are ratios."""

INFLUENCE = 1e-12  # cosine of the angle between two gradients up to which their contacts do not influence each other
LOST = 1e-5  # part of the speed by which a gap velocity may miss its law: large coefficients of friction hide it

# --- Poisson's expansion. ---------------------------------------------------------------------------------------------
KICK_ROUNDING = 2.0**-50  # of the speeds before and after the kick of the least impulses: a bound below it is 0
JAMMED_PART = 1e-10  # part of a gradient that is rounding where its part along other gradients is taken off

"""Tolerances of mechanics: name, value, unit, reason. Tolerances without a unit are ratios."""

SYMMETRY = 1e-10  # asymmetry of M above which it is a mistake and not rounding
SIGNIFICANT = 1e-9  # part of |v-| up to which a velocity or a scaled impulse is rounding and has no sign

IDLE = 1e-10  # length of a gap gradient, relative to the contact's longest friction gradient, up to which it is 0

# --- Bilateral constraints and moving surfaces. -----------------------------------------------------------------------
FIXED = 1e-12  # length of a gradient or velocity after projection, relative to before, up to which it is rounding
SHORTENED = 0.1  # the same, up to which the rounding of the gradient is large next to what is left of it
VELOCITY_RANK = 1e-12  # relative singular value up to which a direction is not used
REACHED = 1e-11  # relative error up to which a velocity of the bodies has the given contact velocities

# --- The set S(v-), in which lengths are divided by its smallest jump |p - v-|. ---------------------------------------
SET_RANK = 1e-10  # singular value up to which unit gradients are dependent; rounding divided by this is 1e-6
SET_CERTIFIED = 1e-7  # violation, relative to |v-|, above which a result is refused
POINT = 1e-12  # part of |v-| below which the smallest jump is rounding, and S is the point v-
TIGHT = 1e-11  # slack of a constraint that counts as 0
NEAR = 1e-9  # slack of a computed corner that may be one
FLAT = 1e-9  # width below which the set has no extent in a direction
SET_ROUNDING = 1e-15  # rounding of a length of one
VANISHING = 1e-13  # rate of a constraint, relative to the move, up to which it is rounding
ON_FACET = 1e-11  # coefficient of unit gradients, or offset of a facet, that is rounding

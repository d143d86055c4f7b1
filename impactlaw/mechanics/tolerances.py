"""The tolerances of mechanics: name, value, unit, reason. Those without a unit are ratios."""

SYMMETRY = 1e-10  # asymmetry of M above which it is taken for a mistake, not for rounding
SIGNIFICANT = 1e-9  # part of |v-| below which a velocity or a scaled impulse is rounding when signs are asked for

IDLE = 1e-10  # part of a contact's longest gradient of friction up to which its gap gradient is rounding

# --- Bilateral constraints and moving surfaces. -----------------------------------------------------------------------
FIXED = 1e-12  # part of a gradient or velocity that is rounding after a projection that takes off the rest
VELOCITY_RANK = 1e-12  # singular value up to which a direction is not used
REACHED = 1e-11  # part of the contact velocities that a velocity of the bodies may miss

# --- The set S(v-), in which lengths are divided by its smallest jump |p - v-|. ---------------------------------------
SET_RANK = 1e-10  # singular value up to which unit gradients are dependent; rounding divided by this is 1e-6
SET_CERTIFIED = 1e-7  # violation, relative to |v-|, above which a result is refused
POINT = 1e-12  # part of |v-| below which the smallest jump is rounding, and S is the point v-
TIGHT = 1e-11  # slack of a constraint that counts as 0
NEAR = 1e-9  # slack of a computed corner that may be one
FLAT = 1e-9  # width below which the set has no extent in a direction
SET_ROUNDING = 1e-15  # rounding of a length of one
VANISHING = 1e-13  # part of a vector that is left of it by rounding
ON_FACET = 1e-11  # coefficient of unit gradients, or offset of a facet, that is rounding
PULL = 4e-15  # pull on a generator of a cone, relative to the point, that counts as 0

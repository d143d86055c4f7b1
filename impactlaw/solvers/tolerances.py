"""The tolerances of solvers without friction: name, value, unit, reason. Those without a unit are ratios."""

EPS = 2.0**-52
"""Spacing of doubles at 1."""

# --- What counts as an answer. Residuals are relative to the speeds before and after, see `Problem.speed_at`. ---------
CERTIFIED = 1e-9  # residual above which an answer is refused
GOOD = 1e-12  # residual at which no other solver is asked: a thousandth of what is refused
GOOD_LARGE = 1e-10  # the same where the other solver would be a dense one for a large sparse problem: it takes seconds
POLISHED = 1e-14  # residual that solving again on the active contacts cannot make smaller
IMPULSE_ROUNDING = 8 * EPS  # of the sum of impulses: what their own rounding makes of a jump where they nearly cancel
JAMMED = 1e-2  # of the speed: beyond it, rounding of impulses is no excuse
TIGHT = 1e-9  # slack of a contact that may share the impulse of others

# --- When gradients, as rows of length one, depend on each other. -----------------------------------------------------
RANK = 1e-11  # singular value, relative to the largest, up to which a direction is rounding
INDEPENDENT = 0.03  # sine of the angle to the span of other gradients: below, G = Y Y^T has lost more than 3 digits
COUPLED = 1e-15  # cosine of the angle between two gradients that is the rounding of 0
NO_IMPULSE = 1e-12  # part of the largest impulse, or of a ray's largest entry, that is rounding

# --- NNLS and the least-distance form. --------------------------------------------------------------------------------
IN_RANGE = 1e-12  # distance of c from the range of Y, relative to the scale of the problem, that is rounding
FARTHEST_JUMP = 1e9  # times the scale of the problem: a longer jump is taken for none

# --- The proof that there is no answer (Farkas ray). ------------------------------------------------------------------
RAY_BALANCED = 1e-10  # length of the sum of a ray's gradients, per sum of its entries, that counts as 0
RAY_CONFLICT = 1e-11  # conflict of the wanted velocities, relative to the largest, that counts as none
RAY_ROUNDING = 1e-12  # the same, relative to the scale of the problem
RAY_OPEN = 1e3  # jumps longer than this many scales are all that a ray with a small imbalance may leave open

# --- The dual active set (daqp). --------------------------------------------------------------------------------------
DAQP_PRIMAL = 1e-11  # violation of a bound, relative to the largest bound
DAQP_DUAL = 1e-12  # the same for multipliers

# --- The primal-dual active set; everything relative to the scale of the problem. -------------------------------------
SINGULAR = 1e-13  # squared sine of the angle to the span of other gradients: below, the system is made definite
SHIFTS = (1e-3, 1e-7)  # first and last addition to the diagonal of G, of unit gradients, that makes it definite
NEAR = 1e-10  # natural map from which the active contacts are likely to be the right ones
SIGNLESS = 1e-15  # impulse or slack whose sign means nothing
DOUBTFUL = 1e-12  # impulse or slack whose sign is decided by refined numbers
ILL = 1e-6  # squared sine below which signs are always decided by refined numbers
REACHED = 1e-9  # natural map of proximal points that are an answer

"""The tolerances of frictionless solvers: name, value, unit, reason. Tolerances without a unit are ratios."""

EPS = 2.0**-52
"""Spacing of doubles at 1."""

# --- Acceptance of an answer. Residuals are relative to the speeds before and after, see `Problem.speed_at`. ----------
CERTIFIED = 1e-9  # largest residual of an accepted answer
GOOD = 1e-12  # residual at which no further solver is tried: a thousandth of the largest accepted one
GOOD_LARGE = 1e-10  # the same if the next solver would be a dense one for a large sparse problem, which takes seconds
POLISHED = 1e-14  # residual that solving again on the active contacts cannot reduce
IMPULSE_ROUNDING = 8 * EPS  # rounding error of a jump, relative to the sum of impulses that nearly cancel in it
JAMMED = 1e-2  # largest allowance for this rounding error, relative to the speed
TIGHT = 1e-9  # largest slack of a contact that may share the impulse of others

TINY = 1e-290
"""Scale, sqrt(J), below which a problem is solved for 2^900 times its velocities: numpy and scipy lose digits, and
scipy's nnls ends the process, where numbers are below the smallest normal double, 2e-308."""

# --- Linear dependence of gradients, scaled to unit length. -----------------------------------------------------------
RANK = 1e-11  # singular value, relative to the largest, below which a direction counts as absent
INDEPENDENT = 0.03  # sine of the angle to the span of other gradients: below, G = Y Y^T has lost more than 3 digits
COUPLED = 1e-15  # cosine of the angle between two gradients up to which they count as orthogonal
NO_IMPULSE = 1e-12  # impulse or entry of a ray, relative to the largest, that counts as zero

# --- NNLS and the least-distance form. --------------------------------------------------------------------------------
IN_RANGE = 1e-12  # distance of c from the range of Y, relative to the scale of the problem, that counts as zero
FARTHEST_JUMP = 1e9  # length of a jump, relative to the scale of the problem, beyond which there is no solution

# --- The proof that there is no solution (Farkas ray). ----------------------------------------------------------------
RAY_BALANCED = 1e-10  # length of the sum of a ray's gradients, relative to the sum of its entries, that counts as zero
RAY_CONFLICT = 1e-11  # conflict of the wanted velocities, relative to the largest, that counts as zero
RAY_ROUNDING = 1e-12  # the same, relative to the scale of the problem
RAY_OPEN = 1e3  # a ray with a small imbalance must exclude all jumps shorter than this, in scales of the problem

# --- The dual active set (daqp). --------------------------------------------------------------------------------------
DAQP_PRIMAL = 1e-11  # violation of a bound, relative to the largest bound
DAQP_DUAL = 1e-12  # the same for multipliers

# --- The primal-dual active set; all relative to the scale of the problem. --------------------------------------------
SINGULAR = 1e-13  # squared sine of the angle to the span of other gradients: below, the system is regularized
SHIFTS = (1e-3, 1e-7)  # first and last addition to the diagonal of G, of unit gradients, that makes it definite
NEAR = 1e-10  # natural map at which the set of active contacts is probably right
SIGNLESS = 1e-15  # impulse or slack that counts as zero
DOUBTFUL = 1e-12  # impulse or slack whose sign is determined after iterative refinement
ILL = 1e-6  # squared sine below which all signs are determined after iterative refinement
REACHED = 1e-9  # largest natural map of a proximal point that counts as a solution

"""The tolerances with which a scene is read: name, value, unit, reason. Those without a unit are ratios."""

GAP_TOLERANCE = 1e-9  # m: gap up to which a contact counts as closed
SKIN = 1e-6
"""Distance, in m, at which two geoms touch if MuJoCo measures it by its general convex collider: all pairs without a
plane, sphere or capsule, but for two boxes. Nearer to zero, that distance is noisier than the gap tolerance and its
direction is lost. Such geoms may start anywhere from no overlap on.
"""
CCD_TOLERANCE = 1e-12  # m, of that collider: MuJoCo's default of 1e-6 makes gaps noisier than the gap tolerance
PARALLEL = 0.99  # cosine of the angle within which MuJoCo takes two faces for parallel
ON_AXIS = 4e-15  # part of distances from the origin that is rounding of a lever arm: the normal meets the axis
ORTHOGONAL = 1e-12  # product of unit vectors up to which they are orthogonal
MIN_FRICTION = 1e-10  # coefficient up to which there is no friction
NO_FRICTION = 1.0000001e-5  # the same of MuJoCo's contacts, whose smallest coefficient is 1e-5 and stands for none
PUT = 20.0
"""Speed, m/s, above which a mocap body that moves farther in a step than it is large has been put somewhere else."""
BLOW = 0.1  # m/s: change of a surface's mean velocity from step to step above which it jumps, which is a collision

# --- Equality constraints, which are soft in MuJoCo: their rows are right up to what they have given way. -------------
GIVEN_WAY = 10.0  # how much more than its part of the bodies' size a violation may change rows
OWN_CONSTRAINT = 1e-2  # singular value above which a constraint is one of its own, whatever has given way
WRITTEN = 1e-4
"""How much rows differ, as a part of their length, by the digits in which poses are written in MJCF files, at least."""

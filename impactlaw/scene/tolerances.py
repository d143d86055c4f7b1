"""Tolerances for reading scenes: name, value, unit, reason. Tolerances without a unit are ratios."""

import numpy as np

GAP_TOLERANCE = 1e-9  # m: gap up to which a contact counts as closed
SKIN = 1e-6
"""Distance, in m, at which two geoms count as touching if MuJoCo measures them by its general convex collider. It does
so for all pairs without a plane, sphere or capsule, except two boxes. At smaller distances the result is noisier than
the gap tolerance, and its direction is lost. Such geoms may start at any distance at which they do not overlap.
"""
CCD_TOLERANCE = 1e-12  # m, of this collider: MuJoCo's default of 1e-6 makes gaps noisier than the gap tolerance
PARALLEL = 0.99  # cosine of the angle up to which MuJoCo treats two faces as parallel
ON_AXIS = 4e-15  # lever arm, relative to distances from the origin, that is rounding: the normal meets the axis
NO_LEVER = 1e-10  # the same, relative to the longest lever arm of the contact point in any direction
SHORT = 1e-8  # length of a gap gradient, m or without unit, up to which it may be rounding
ORTHOGONAL = 1e-12  # scalar product of unit vectors up to which they are orthogonal
UPRIGHT = 1e-10  # sine of the tilt up to which a cylinder on a plane has an axis along the normal
ROUNDED = 1e-13  # m: largest error of a distance that is left as it is
MISSES_AXIS = 5e-2  # distance, relative to the radius, by which the normal of a contact may miss a cylinder's axis
SAME_NORMAL = 1e-9  # difference of normals up to which points are on one face
SIDE_BY_SIDE = 5e-2  # tangent of the angle between the axes of two cylinders up to which they touch along a line
CROSSED = 1e-2
"""Distance by which one axis passes beside the other at the ends of that line, relative to the sum of the radii, at
most: cylinders that cross at an angle touch along a shorter line.
"""
CROSSES = 0.5  # cosine of the angle between axes from which MuJoCo does not measure crossing cylinders well
SHORT_LINE = 1e-2  # length of that line, relative to the sum of the radii, up to which it is a point with a capsule
THIN_LINE = 1e-4  # the same for two cylinders, as for disks that hit each other rim to rim
SUNK_IN = 0.5  # distance of the axes, relative to the sum of the radii, up to which cylinders are not side by side
TOUCHING = 1e-6  # m: gap up to which a contact can hide others behind its plane
FLUSH = 2e-6  # m: distance from that plane up to which geoms do not cross it
SUNK = 1.25  # depth of a tilted body, relative to that of its contact points, up to which it has sunk no deeper
APART = 1e-5
"""Distance, m, up to which MuJoCo is at least asked to measure. If it is asked for overlaps only, it takes cylinders
that touch for cylinders that overlap by a third of their size.
"""
PROBE = 1e-4  # m: how far a body is moved into a contact along the floor, beyond its gap, to see whether it gets deeper
SUNK_MEASURED = 3.0  # the same where the body is moved to see whether it gets deeper
ASKEW, ASKEW_SPHERE = 0.5, 1.0 - 1e-6  # cosine of the angle to its normal up to which it hides contacts
ASKEW_MEASURED = 0.9  # the same where the body is moved to see whether it gets deeper
OUT_OF_REACH = 1.0  # m: gap given to hidden contacts
NEVER = -1e10  # m: lower limit that the length of a rope never reaches
MIN_FRICTION = 1e-10  # coefficient up to which there is no friction
NO_FRICTION = 1.0000001e-5  # the same for MuJoCo's contacts, whose smallest coefficient, 1e-5, means no friction
PUT = 20.0
"""Speed, m/s, above which a mocap body that moves farther in a step than its size has been put somewhere else."""
BLOW = 0.1  # m/s: change of a surface's mean velocity between steps above which it jumps and causes a collision

# --- Equality constraints. They are soft in MuJoCo: their rows are exact only up to their violation. ------------------
GIVEN_WAY = 10.0  # factor from the violation, relative to the size of bodies, to the change of rows that is allowed for
OWN_CONSTRAINT = 1e-2  # singular value above which a row is independent, however far constraints have given way
WRITTEN = 1e-4
"""Least relative error of rows, from the digits with which poses are written in MJCF files."""

# --- Units. -----------------------------------------------------------------------------------------------------------
_EARTH = 9.81  # m/s^2: gravity
_STRONG = 100.0  # m/s^2: gravity above which the unit of length is not a meter


def meter(gravity: np.ndarray) -> float:
    """Return the length of a meter in the units of a scene, as told by its gravity, (3,).

    Gravity above 100 is taken for that of the earth: it is 981 in centimeters and 9810 in millimeters, with seconds.
    """
    strength = float(np.linalg.norm(gravity))
    return strength / _EARTH if strength > _STRONG else 1.0

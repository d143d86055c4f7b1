"""Event-driven rigid stepping.

The arrays of a step are small, and most of the time is spent in calls. Therefore this package writes ``a.dot(b)`` and
``np.count_nonzero(mask)``, which take 0.4 us, instead of ``a @ b`` and ``mask.any()``, which take 1.5 us. This saves a
tenth of a step. Where several operations on each contact follow each other, it loops over plain numbers (`tolist`),
which takes less time than arrays for up to some twenty contacts; this saves another tenth of a step with collisions.
"""

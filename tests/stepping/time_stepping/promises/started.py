"""Scenes for tests of the guarantees of time stepping, and the state of a model."""

import numpy as np
from stepping.time_stepping.stepped import FLOOR


def box(name, pos, size=0.1, more="", mass=1.0):
    return f"""<body name="{name}" pos="{pos}"><freejoint/>
        <geom name="{name}" type="box" size="{size} {size} {size}" mass="{mass}" {more}/></body>"""


def pile(n=6):
    rng = np.random.default_rng(5)
    return FLOOR + "".join(
        f'<body pos="{x} {y} {0.25 * i + 0.15}" euler="{a} {b} 0"><freejoint/>'
        f'<geom type="{kind}" size=".1 .08 .06"/></body>'
        for i, (x, y, a, b, kind) in enumerate(
            zip(
                *rng.uniform(-0.05, 0.05, (2, n)),
                *rng.uniform(-90, 90, (2, n)),
                (["box", "capsule", "ellipsoid"] * n)[:n],
                strict=True,
            )
        )
    )


def model_state(model):
    """Return the complete contents of a model, as bytes."""
    opt = {name: np.array(getattr(model.opt, name)) for name in dir(model.opt) if not name.startswith("_")}
    arrays = {
        name: getattr(model, name).copy()
        for name in dir(model)
        if not name.startswith("_") and isinstance(getattr(model, name), np.ndarray)
    }
    return opt | arrays


def assert_same(now, before):
    assert now.keys() == before.keys()
    for name, value in before.items():
        np.testing.assert_array_equal(now[name], value, err_msg=name)

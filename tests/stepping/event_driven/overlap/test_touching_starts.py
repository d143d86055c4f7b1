"""Bodies that touch at the start, of shapes that count as touching a skin before they do (`scene.tolerances.SKIN`)."""

import pytest
from scenes import compiled, run

from impactlaw import Moreau, Stepper

BLOCK = "".join(f"{x} {y} {z} " for x in (-0.125, 0.125) for y in (-0.125, 0.125) for z in (-0.25, 0.25))
ASSETS = f'<asset><mesh name="block" vertex="{BLOCK}"/></asset>'  # of numbers that single precision holds
SHAPES = ('type="mesh" mesh="block"', 'type="cylinder" size=".125 .25"', 'type="ellipsoid" size=".125 .125 .25"')
FLOOR = '<geom type="box" size="2 2 1" pos="0 0 -1"/>'


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize(
    ("gap", "tolerance"), [(0.0, 1e-9), (-5e-10, 1e-9), (0.0, 1e-10), (5e-7, 1e-10), (0.0, 1e-8), (1e-6, 1e-9)]
)
def test_what_touches_at_the_start_is_held(shape, gap, tolerance):
    """It begins up to the skin nearer than where it is held, which is no overlap of contact that was not held."""
    body = f'<body pos="0 0 {0.25 + gap:.17g}"><freejoint/><geom {shape} mass="1"/></body>'
    model, data = compiled(FLOOR + body, ASSETS)
    stepper = Stepper(model, Moreau(0.5), gap_tolerance=tolerance, on_unsolved="raise")
    assert run(stepper, data, 5) == []
    assert abs(data.qpos[2] - 0.25) < 2e-6

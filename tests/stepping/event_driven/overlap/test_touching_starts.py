"""Bodies that touch at the start, of shapes that count as touching a skin earlier (`scene.tolerances.SKIN`)."""

import pytest
from scenes import compiled, run

from impactlaw import Moreau, Stepper
from impactlaw.errors import OverlapError

BLOCK = "".join(f"{x} {y} {z} " for x in (-0.125, 0.125) for y in (-0.125, 0.125) for z in (-0.25, 0.25))
ASSETS = f'<asset><mesh name="block" vertex="{BLOCK}"/></asset>'  # numbers that are exact in single precision
SHAPES = ('type="mesh" mesh="block"', 'type="cylinder" size=".125 .25"', 'type="ellipsoid" size=".125 .125 .25"')
FLOOR = '<geom type="box" size="2 2 1" pos="0 0 -1"/>'


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize(
    ("gap", "tolerance"), [(0.0, 1e-9), (-5e-10, 1e-9), (0.0, 1e-10), (5e-7, 1e-10), (0.0, 1e-8), (1e-6, 1e-9)]
)
def test_what_touches_at_the_start_is_held(shape, gap, tolerance):
    """The body starts up to the skin closer than it is held, which is not an overlap of a held contact."""
    body = f'<body pos="0 0 {0.25 + gap:.17g}"><freejoint/><geom {shape} mass="1"/></body>'
    model, data = compiled(FLOOR + body, ASSETS)
    stepper = Stepper(model, Moreau(0.5), gap_tolerance=tolerance, on_unsolved="raise")
    assert run(stepper, data, 5) == []
    assert abs(data.qpos[2] - 0.25) < 2e-6


def rests(half, depth, field=False):
    """Return a mesh of a given half height, slightly below its place on a plane, or on a flat height field."""
    bar = "".join(f"{x} {y} {z} " for x in (-0.1, 0.1) for y in (-0.1, 0.1) for z in (-half, half))
    grid = '<hfield name="field" nrow="3" ncol="3" size="2 2 .3 .1" elevation="3 3 3 3 3 3 3 0 10"/>' if field else ""
    floor = '<geom type="hfield" hfield="field"/>' if field else '<geom type="plane" size="2 2 1"/>'
    body = f'<body pos="-1 -1 {half + (0.09 if field else 0.0) - depth}"><freejoint/>'
    shape = '<geom type="sphere" size=".1" mass="1"/>' if field else '<geom type="mesh" mesh="bar" mass="1"/>'
    return compiled(floor + body + shape + "</body>", f'<asset>{grid}<mesh name="bar" vertex="{bar}"/></asset>')


@pytest.mark.parametrize(("half", "field"), [(0.1, False), (0.3, False), (1.1, False), (0.1, True)])
def test_points_that_are_rounded_to_single_precision_do_not_overlap(half, field):
    """MuJoCo stores 0.1 as 0.1000000015: bodies that touch in the scene overlap by 1e-9 to 1e-7 m."""
    model, data = rests(half, 0.0, field)
    height = data.qpos[2]
    assert run(Stepper(model, Moreau(0.5), on_unsolved="raise"), data, 20) == []
    assert abs(data.qpos[2] - height) < 1e-7


@pytest.mark.parametrize("field", [False, True])
def test_what_is_deeper_than_that_is_refused(field):
    model, data = rests(0.1, 1e-6, field)
    with pytest.raises(OverlapError, match=r"by 1(\.0\d)?e-06 m"):
        Stepper(model, Moreau(0.5)).step(data)

"""Contact raises no exceptions: every law in every scene, overlap, redundance, unsolvable laws, many rows."""

import mujoco
import numpy as np
import pytest
from scenes import compiled, run
from stepping.time_stepping.promises.started import box
from stepping.time_stepping.stepped import FLOOR, stepping

from impactlaw import Fremond, MaximalDissipation, Moreau, Newton, Poisson
from impactlaw.models import SCENES, load

LAWS = {
    "maximal dissipation": MaximalDissipation(),
    "moreau": Moreau(0.5),
    "newton of speed": Newton(lambda speed: 0.5),
    "poisson": Poisson(0.5),
    "reversal": Fremond.reversal(),
}
every_law = pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
every_scene = pytest.mark.parametrize("scene", SCENES)


@every_law
@every_scene
def test_every_scene_runs_under_every_law(scene, law):
    model, data = load(scene)
    stepper = stepping(model, law)
    for _ in range(60):
        stepper.step(data)
        assert np.isfinite(stepper.shortfall)
    assert np.isfinite(data.qpos).all()
    assert stepper.unlocated == 0


HARD = {
    "overlap": FLOOR + box("a", "0 0 .02") + box("b", "0.05 0.02 .12"),
    "one in the other": box("a", "0 0 1") + box("b", "0 0 1"),
    "squeezed": '<geom type="box" size="1 1 .1"/><geom type="box" size="1 1 .1" pos="0 0 .35"/>' + box("a", "0 0 .175"),
    "squeezed ball": '<geom type="box" size="1 1 .1"/><geom type="box" size="1 1 .1" pos="0 0 .38"/>'
    '<body pos="0 0 .19"><freejoint/><geom size=".1"/></body>',
    "narrowing wedge": '<geom type="plane" size="9 9 1" zaxis="1 0 .01"/>'
    '<geom type="plane" size="9 9 1" zaxis="-1 0 .01"/>'
    '<body pos="0 0 1"><freejoint/><geom size=".1"/></body>',
}


@every_law
@pytest.mark.parametrize("name", HARD)
def test_overlapping_and_squeezed_bodies_end_without_an_exception_and_gain_no_speed(name, law):
    model, data = compiled(HARD[name], option='gravity="0 0 -9.81"', geom='friction=".5"')
    stepper = stepping(model, law)
    mujoco.mj_forward(model, data)
    mujoco.mj_energyPos(model, data)
    highest = data.energy[0]
    for _ in range(200):
        stepper.step(data)
        mujoco.mj_energyPos(model, data)
        mujoco.mj_energyVel(model, data)
        highest = max(highest, data.energy[0])  # overlaps open upwards, which adds potential energy
        assert data.energy[1] <= highest - data.energy[0] + 1e-6
        assert np.isfinite(data.qpos).all()


@pytest.mark.parametrize("depth", [1e-4, 1e-2, 0.05])
def test_overlaps_open_at_a_limited_speed_and_add_none(depth):
    """Two free balls in space: only the positions open, by the same amount, at 0.2 m/s or faster."""
    world = "".join(f'<body pos="{x} 0 0"><freejoint/><geom size=".1" mass="1"/></body>' for x in (0, 0.2 - depth))
    model, data = compiled(world, option='gravity="0 0 0"')
    stepper = stepping(model, Newton(0.5))
    before = 0.2 - depth
    for _ in range(300):
        stepper.step(data)
        now = data.qpos[7] - data.qpos[0]
        opened, before = now - before, now
        assert 0 <= opened <= (0.2 + depth / 0.1) * model.opt.timestep + 1e-12
        assert opened > 0.19 * model.opt.timestep or now > 0.2 - 1e-3
        assert abs(data.qvel).max() < 1e-12
    assert now == pytest.approx(0.2, abs=1e-7)
    assert data.qpos[0] + data.qpos[7] == pytest.approx(0.2 - depth, abs=1e-12)


def test_a_limit_that_is_exceeded_at_the_start_opens_over_time():
    world = '<body><joint type="hinge" axis="0 1 0" range="-10 10"/><geom size=".1" pos="0 0 -.5"/></body>'
    model, data = compiled(world, option='gravity="0 0 0"')
    data.qpos[0] = 0.5
    stepper = stepping(model, Moreau(0.5))
    run(stepper, data, 1500)
    assert data.qpos[0] == pytest.approx(np.radians(10), abs=1e-6)
    assert abs(data.qvel[0]) < 1e-12


@every_law
def test_redundant_welds_hold(law):
    world = FLOOR + box("a", "0 0 .1") + box("b", "0 0 .31") + box("c", "0 0 .52")
    welds = "".join(f'<weld body1="{a}" body2="{b}"/>' for a, b in ("ab", "bc", "ac", "ab", "ca"))
    model, data = compiled(world, f"<equality>{welds}</equality>")
    data.qvel[:] = 0
    stepper = stepping(model, law)
    run(stepper, data, 100)
    assert np.isfinite(data.qpos).all()
    assert abs(data.qvel).max() < 0.5


def test_a_law_without_solution_goes_to_the_nearest_point():
    """The corners of a box ask for different speeds, which no motion has; there is an event all the same."""
    corners = "".join(
        f'<geom name="{n}" size=".02" pos="{x} {y} -.1"/>' for n, x, y in (
            ("a", 0.1, 0.1), ("b", -0.1, 0.1), ("c", 0.1, -0.1), ("d", -0.1, -0.1),
        )
    )  # fmt: skip
    body = f'<body pos="0 0 .15"><freejoint/><geom type="box" size=".1 .1 .1"/>{corners}</body>'
    model, data = compiled(FLOOR + body, geom='condim="1"')
    data.qvel[2] = -1.0
    law = Newton({("a", "floor"): 1.0, ("d", "floor"): 1.0}, default=0.0)
    stepper = stepping(model, law)
    events = run(stepper, data, 200)
    assert events
    assert events[0].contacts.labels
    assert np.isfinite(data.qpos).all()


def test_thousands_of_rows_are_no_error():
    """A thousand balls in a grid touch the floor with friction, all at the same time."""
    balls = "".join(
        f'<body pos="{0.21 * (i % 32)} {0.21 * (i // 32)} .1"><freejoint/><geom size=".1"/></body>' for i in range(1000)
    )
    model, data = compiled('<geom type="plane" size="99 99 1"/>' + balls)
    assert model.nv == 6000
    start = data.qpos.copy()
    stepper = stepping(model, Moreau(0.5))
    for _ in range(2):
        stepper.step(data)
    assert data.nefc > 2999
    assert data.qpos == pytest.approx(start, abs=1e-9)
    assert stepper.shortfall < 1e-8


def test_a_box_on_a_grid_of_sixty_four_coplanar_feet_stays():
    feet = "".join(
        f'<geom size=".01" pos="{x} {y} -.09"/>' for x in np.linspace(-1, 1, 8) for y in np.linspace(-1, 1, 8)
    )
    body = f'<body pos="0 0 .1"><freejoint/><geom type="box" size="1 1 .09" contype="0" conaffinity="0"/>{feet}</body>'
    model, data = compiled(FLOOR + body)
    start = data.qpos.copy()
    stepper = stepping(model, Moreau(0.5))
    assert run(stepper, data, 50) == []
    assert data.qpos == pytest.approx(start, abs=1e-9)

"""Bodies that slide over floors of several boxes pass over the edges between them."""

import mujoco
import numpy as np
import pytest

from impactlaw import Moreau, Stepper

SHAPES = {
    "box": '<geom type="box" size=".07 .05 .04" mass="1" friction="0" condim="1"/>',
    "puck": '<geom type="cylinder" size=".06 .04" mass="1" friction="0" condim="1"/>',
    "sphere": '<geom type="sphere" size=".04" mass="1" friction="0" condim="1"/>',
}


def _slide(shape, ahead):
    """Return the velocity after half a second over a floor that ends at x = 0, and the number of collisions."""
    model = mujoco.MjModel.from_xml_string(f"""
    <mujoco>
      <option integrator="RK4"/>
      <worldbody>
        <geom type="box" size=".5 .5 .1" pos="-.5 0 -.1" friction="0" condim="1"/>
        <geom type="box" {ahead} friction="0" condim="1"/>
        <body pos="-.2 0 .04" euler="0 0 20"><freejoint/>{SHAPES[shape]}</body>
      </worldbody>
    </mujoco>""")
    data = mujoco.MjData(model)
    data.qvel[0] = 1.0
    stepper, collisions = Stepper(model, Moreau(0.5), scheme="time-stepping"), 0
    for _ in range(250):
        stepper.step(data)
        collisions += stepper.sums.collisions
    assert stepper.short_steps == 0
    return data.qvel, collisions


@pytest.mark.parametrize("shape", SHAPES)
def test_bodies_slide_on_over_the_next_box(shape):
    velocity, collisions = _slide(shape, 'size=".5 .5 .1" pos=".5 0 -.1"')
    np.testing.assert_allclose(velocity, [1.0, 0.0, 0.0, 0.0, 0.0, 0.0], atol=1e-7)
    assert collisions == 0


@pytest.mark.parametrize("shape", SHAPES)
def test_bodies_bounce_off_a_wall_on_the_floor(shape):
    velocity, collisions = _slide(shape, 'size=".1 .5 .3" pos=".1 0 .3"')
    assert collisions > 0
    assert velocity[0] < 0.0


def test_a_puck_hits_a_step():
    velocity, collisions = _slide("puck", 'size=".5 .5 .1" pos=".5 0 -.09999"')
    assert collisions > 0
    assert velocity[0] < 0.5


def test_a_sphere_hits_the_edge_of_a_step():
    velocity, collisions = _slide("sphere", 'size=".5 .5 .1" pos=".5 0 -.098"')
    assert collisions > 0
    assert velocity[0] < 1.0 - 1e-3


def _block(name, low, high):
    """Return a mesh that is a box between two corners, m."""
    corners = ((x, y, z) for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2]))
    return f'<mesh name="{name}" vertex="{" ".join(f"{c} {d} {e}" for c, d, e in corners)}"/>'


def _overlap(xml, start, *, seconds=0.4, restitution=0.5, mocap=None):
    """Return the largest overlap of bodies, m, and the position at the end."""
    model = mujoco.MjModel.from_xml_string(f'<mujoco><default><geom friction="0"/></default>{xml}</mujoco>')
    data, now, deepest = mujoco.MjData(model), mujoco.MjData(model), 0.0
    data.qvel[: len(start)] = start
    if mocap is not None:
        data.mocap_pos[0] = mocap
    stepper = Stepper(model, Moreau(restitution), scheme="time-stepping")
    for _ in range(round(seconds / model.opt.timestep)):
        stepper.step(data)
        now.qpos[:], now.mocap_pos[:] = data.qpos, data.mocap_pos
        mujoco.mj_fwdPosition(model, now)
        deepest = max(deepest, *(-now.contact.dist), 0.0)
    return deepest, data.qpos


RAMP = (
    '<asset><mesh name="ramp" vertex="0 -1 0 0 1 0 {0} -1 1 {0} 1 1 {0} -1 -.1 {0} 1 -.1 0 -1 -.1 0 1 -.1"/></asset>'
    '<worldbody><geom type="plane" size="9 9 1"/><geom type="mesh" mesh="ramp"/>'
    '<body pos="-.53 .03 .1"><freejoint/><geom type="{1}" size="{2}" mass="1"/></body>'
    "</worldbody>"
)


@pytest.mark.parametrize(("run", "speed"), [(1.7320508, 2.0), (1.0, 5.0)])
def test_a_ball_does_not_enter_a_ramp_behind_its_floor(run, speed):
    deepest, _ = _overlap(RAMP.format(run, "sphere", ".1"), [speed])
    assert deepest < 1e-5


def test_a_box_does_not_enter_a_wall_if_its_floor_and_the_wall_are_meshes():
    floor = _block("floor", (-2.0, -1.0, -0.2), (1.0, 1.0, 0.0))
    wall = _block("wall", (0.0, 0.0, -0.2), (1.0, 1.0, 0.3))
    scene = (
        f'<asset>{floor}{wall}</asset><worldbody><geom type="mesh" mesh="floor"/><geom type="mesh" mesh="wall"/>'
        '<body pos="-.5 -.05 .1" euler="0 0 30"><freejoint/><geom type="box" size=".1 .2 .1" mass="1"/></body>'
        "</worldbody>"
    )
    deepest, _ = _overlap(scene, [1.3])
    assert deepest < 1e-5


@pytest.mark.parametrize("sides", [(1, -1), (-1, 1)])
@pytest.mark.parametrize("restitution", [0.0, 0.5, 1.0])
def test_a_ball_that_falls_into_the_middle_of_a_groove_hits_both_sides(sides, restitution):
    slope = np.radians(10.0)
    along, across = 2.0 * np.array([np.cos(slope), np.sin(slope)]), 0.2 * np.array([np.sin(slope), np.cos(slope)])
    walls = "".join(
        f'<geom type="box" size="2 2 .2" euler="0 {10 * s} 0" pos="{-s * (along[0] + across[0])} 0 '
        f'{along[1] - across[1]}"/>'
        for s in sides
    )
    ball = '<body pos="0 0 .4"><freejoint/><geom size=".1" mass="1"/></body>'
    _, position = _overlap(f"<worldbody>{walls}{ball}</worldbody>", [], restitution=restitution)
    np.testing.assert_allclose(position[:2], 0.0, atol=1e-9)


def test_bodies_that_a_mocap_body_carries_do_not_enter_walls():
    scene = """<worldbody>
    <geom type="box" size=".5 .5 .1" pos="5 0 -.2"/><geom type="box" size=".1 .5 1" pos="5.6 0 0"/>
    <body mocap="true">
      <body><joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 1"/><geom size=".1" mass="1"/></body>
    </body></worldbody>"""
    deepest, _ = _overlap(scene, [1.77, -0.1], restitution=0.0, mocap=[5.0, 0.0, 0.0015])
    assert deepest < 1e-5

"""Contacts whose normal intersects the axis of the only joint: their normal impulses cannot move the body."""

import mujoco
import numpy as np
import pytest
from scenes import compiled

from impactlaw import Collision, Coulomb, Friction, MaximalDissipation, Moreau, Poisson, Stepper
from impactlaw.scene.contacts import active_contacts, gap_gradients, geom_names

ARM = """<geom type="box" size=".05 .05 .02" pos="0 0 -.0195"/>
  <body pos="{at} 0 .01"><joint axis="0 1 0"/><geom type="capsule" fromto="0 0 0 .04 0 0" size=".01"/></body>"""


@pytest.mark.parametrize("at", [0.0, 0.01, -0.013])
def test_the_gap_gradient_is_zero_and_not_rounding(at):
    model, data = compiled(ARM.format(at=at))
    data.qpos[0] = 1e-3
    mujoco.mj_forward(model, data)
    rows = gap_gradients(model, data, active_contacts(model, data, geom_names(model)))
    lengths = np.sort(np.abs(rows[:, 0]))
    assert len(lengths) == 2
    assert lengths[0] == 0.0
    assert lengths[1] == pytest.approx(0.04, abs=1e-4)


def collision(rounding=0.0):
    """Return one joint, 0.01 m above a plane, with a contact below it and a closing one at the end of the arm."""
    friction = Friction(np.array([[0.01], [0.01]]), [0, 1], [1.0, 0.5])
    return Collision(np.array([[2e-5]]), np.array([[rounding], [-0.04]]), np.array([3.0]), friction=friction)


@pytest.mark.parametrize("cone", ["exact", "convex"])
@pytest.mark.parametrize("law", [MaximalDissipation(), Moreau(0.5), Moreau(1.0)])
@pytest.mark.parametrize("rounding", [0.0, 1e-16, -1e-13])
def test_a_contact_that_nothing_moves_has_no_friction(law, cone, rounding):
    """The end of the arm, where friction and normal act on one joint, bounces as if it were the only contact."""
    whole = collision(rounding)
    alone = Collision(
        whole.mass_matrix, whole.jacobian[1:], whole.pre_velocity, friction=whole.friction.select(np.array([1]))
    )
    impact = Coulomb(law, cone=cone).resolve(whole)
    assert impact.residual < 1e-12
    np.testing.assert_allclose(impact.impulse[0], 0.0, atol=0.0)
    np.testing.assert_allclose(impact.post_velocity, Coulomb(law, cone=cone).resolve(alone).post_velocity, rtol=1e-12)


@pytest.mark.parametrize("rounding", [1e-16, -1e-13])
def test_the_same_by_poisson(rounding):
    impact, wanted = (Coulomb(Poisson(0.5)).resolve(collision(normal)) for normal in (rounding, 0.0))
    assert impact.impulse[0] == wanted.impulse[0] == 0.0
    assert impact.post_velocity == pytest.approx(wanted.post_velocity, rel=1e-12)
    assert impact.post_contact_velocity[1] >= 0.0


@pytest.mark.parametrize("way", [{}, {"scheme": "time-stepping"}])
def test_an_arm_that_falls_flat_bounces(way):
    """The arm turns onto the palm: only its end bounces, whatever lies below its hinge."""
    model, data = compiled(
        ARM.format(at=0.0).replace(".0195", ".02"), option='gravity="0 0 0" timestep="1e-3"', geom='friction="1"'
    )
    data.qpos[0], data.qvel[0] = -0.02, 2.0
    stepper = Stepper(model, Moreau(0.5), **way)
    for _ in range(30):
        stepper.step(data)
    assert data.qvel[0] == pytest.approx(-1.0, abs=0.3)
    assert stepper.short_steps == 0


HIP = """<body name="torso"><freejoint/><geom name="waist" {waist} mass="3"/>
  <body pos="0 .105 -.04"><joint axis="0 0 1"/><geom size=".02" mass=".3" contype="0" conaffinity="0"/>
    <body><joint axis="1 0 0"/><geom size=".02" mass=".3" contype="0" conaffinity="0"/>
      <body name="thigh"><joint axis="0 1 0"/><geom name="thigh" type="capsule" fromto="0 0 0 0 0 -.35" size=".05"/>
  </body></body></body></body><geom name="floor" type="plane" size="9 9 1"/>"""
WAISTS = 'size=".08"', 'type="box" size=".08 .08 .04"', 'type="cylinder" size=".08 .04"'
APART = '<contact><exclude body1="torso" body2="thigh"/></contact>'


def landing(model, seed):
    """Return a random pose in which the lower one of waist and thigh has just touched the floor, at 2 m/s."""
    rng, data = np.random.default_rng(seed), mujoco.MjData(model)
    data.qpos[3:7] = rng.normal(size=4)
    mujoco.mj_normalizeQuat(model, data.qpos)
    data.qpos[:2], data.qpos[2], data.qpos[7:] = rng.uniform(-0.3, 0.3, 2), 1.0, rng.uniform(-0.4, 0.4, 3)
    mujoco.mj_kinematics(model, data)
    floor, names = model.geom("floor").id, ("waist", "thigh")
    data.qpos[2] -= min(mujoco.mj_geomDistance(model, data, floor, model.geom(name).id, 9.0, None) for name in names)
    data.qpos[2] -= 1e-6
    data.qvel[:] = 0.5 * rng.normal(size=model.nv)
    data.qvel[2] = -2.0
    return data


@pytest.mark.parametrize("law", [Moreau(0.5), Coulomb(Moreau(0.5))])
@pytest.mark.parametrize("waist", WAISTS)
def test_geoms_that_overlap_where_all_joints_between_them_meet_do_nothing(waist, law):
    """The axes of a hip meet in the center of an end of the thigh, inside the waist: nothing can push it out."""
    scenes = [compiled(HIP.format(waist=waist), after)[0] for after in ("", APART)]
    several = 0
    for seed in range(40):
        whole, alone = (Collision.from_mujoco(m, landing(m, seed), friction=isinstance(law, Coulomb)) for m in scenes)
        if "waist/thigh" not in whole.labels or whole.gradient_norms[whole.labels.index("waist/thigh")] > 1e-6:
            continue  # the thigh itself touches the waist
        several += 1
        impact, wanted = law.resolve(whole), law.resolve(alone)
        np.testing.assert_allclose(impact.post_velocity, wanted.post_velocity, rtol=1e-9, atol=1e-9)
        assert impact.energy_change == pytest.approx(wanted.energy_change, rel=1e-9)
    assert several >= 10

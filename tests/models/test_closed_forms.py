"""The closed-form answer in the comment of every scene, from the scene's own mass matrix and Jacobians."""

import mujoco
import numpy as np
import pytest
from scenes import TOUCHING, chain_labels, detect, label

from impactlaw.laws import Fremond, MaximalDissipation, Moreau, Newton
from impactlaw.mechanics.collision import Collision
from impactlaw.models import load
from impactlaw.stepping.stepper import Stepper

SWAP = np.array([[0.0, 1.0], [1.0, 0.0]])


def collision_at(name, qpos=None, qvel=None) -> Collision:
    """Return the closed contacts of a scene as a collision, directly from MuJoCo's mass matrix and Jacobians."""
    model, data = load(name)
    data.qpos[:] = data.qpos if qpos is None else qpos
    data.qvel[:] = data.qvel if qvel is None else qvel
    contacts = detect(model, data, within=1e-9)
    M = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, M)
    J = np.zeros((len(contacts), model.nv))
    for row, contact in zip(J, contacts, strict=True):
        for sign, geom in ((-1, contact.geom1), (1, contact.geom2)):
            point = np.zeros((3, model.nv))
            mujoco.mj_jac(model, data, point, None, contact.pos, model.geom_bodyid[geom])
            row += sign * contact.frame[:3] @ point
    return Collision(M, J, data.qvel, labels=tuple(label(model, c) for c in contacts))


def check(impact, *, velocity=None, gamma=None, impulse=None, energy=None):
    if velocity is not None:
        np.testing.assert_allclose(impact.post_velocity, velocity, atol=1e-12)
    if gamma is not None:
        np.testing.assert_allclose(impact.post_contact_velocity, gamma, atol=1e-12)
    if impulse is not None:
        np.testing.assert_allclose(impact.impulse, impulse, atol=1e-12)
    if energy is not None:
        kept = 1 + impact.energy_change / impact.collision.kinetic_energy
        assert kept == pytest.approx(energy, abs=1e-12)


def test_newtons_cradle():
    c = collision_at("newtons_cradle")
    assert c.labels == tuple(chain_labels(5))
    np.testing.assert_allclose(c.pre_contact_velocity, [-1, 0, 0, 0], atol=1e-15)
    check(Fremond.reversal().resolve(c), velocity=[0, 0, 0, 0, 1], energy=1)
    check(MaximalDissipation().resolve(c), velocity=[0.2] * 5, energy=1 / 5)
    check(Moreau(1).resolve(c), velocity=[-0.6, 0.4, 0.4, 0.4, 0.4], energy=1)
    height = 2 * c.kinetic_energy / (2 * 9.81)
    assert np.degrees(np.arccos(1 - height)) == pytest.approx(18.4, abs=0.05)


def test_ball_chain():
    c = collision_at("ball_chain")
    np.testing.assert_allclose(c.delassus, [[2, -1], [-1, 2]], atol=1e-15)
    check(MaximalDissipation().resolve(c), velocity=[1 / 3] * 3, impulse=[2 / 3, 1 / 3], energy=1 / 3)
    check(Moreau(1).resolve(c), velocity=[-1 / 3, 2 / 3, 2 / 3], impulse=[4 / 3, 2 / 3], energy=1)
    check(Fremond(SWAP).resolve(c), velocity=[0, 0, 1], impulse=[1, 1], energy=1)
    mixed = Fremond(0.25 * np.eye(2) + 0.75 * SWAP).resolve(c)
    check(mixed, velocity=[-1 / 12, 1 / 6, 11 / 12], impulse=[13 / 12, 11 / 12], energy=7 / 8)
    np.testing.assert_allclose(mixed.topology, [13 / 24, 11 / 24], atol=1e-12)


def test_bouncing_ball():
    speed = np.sqrt(2 * 9.81)
    impact = Newton(0.5).resolve(collision_at("bouncing_ball", qpos=[0], qvel=[-speed]))
    check(impact, velocity=[speed / 2], energy=1 / 4)
    assert impact.impulse[0] == pytest.approx(6.644170, abs=1e-6)


def test_wedge():
    c = collision_at("wedge")
    np.testing.assert_allclose(c.jacobian, [[0, 1], [-0.8, 0.6]], atol=1e-15)
    np.testing.assert_allclose(c.pre_contact_velocity, [-1, -1.2], atol=1e-15)
    check(MaximalDissipation().resolve(c), velocity=[0, 0], impulse=[7 / 16, 15 / 16], energy=0)
    check(Moreau(1).resolve(c), velocity=[-0.75, 1], impulse=[7 / 8, 15 / 8], energy=1)
    swapped = Fremond(SWAP).resolve(c)
    check(swapped, velocity=[-0.35, 1.2], impulse=[11 / 8, 11 / 8], energy=1)
    np.testing.assert_array_equal(swapped.antidissipative, [True, False])
    for wall, velocity, impulse in ((0, [0.75, 1], 2), (1, [-1.17, 0.44], 12 / 5)):
        alone = Collision(c.mass_matrix, c.jacobian[[wall]], c.pre_velocity)
        check(Moreau(1).resolve(alone), velocity=velocity, impulse=[impulse], energy=1)
        assert (c.jacobian @ velocity > -1e-15).all()  # and therefore a corner of S


def test_wedge_area_of_possible_right_velocities():
    c = collision_at("wedge")
    grid = np.linspace(-1.25, 1.25, 2001)
    v = np.stack(np.meshgrid(grid, grid), axis=-1).reshape(-1, 2)
    impulse = (v - c.pre_velocity) @ np.linalg.inv(c.jacobian)
    inside = ((v @ c.jacobian.T >= 0) & (impulse >= 0)).all(axis=1) & (np.linalg.norm(v, axis=1) <= 1.25)
    area = inside.sum() * (grid[1] - grid[0]) ** 2
    assert area == pytest.approx(25 / 16 * np.arctan(4 / 3) + 77 / 600, abs=5e-3)
    assert area == pytest.approx(1.577232, abs=5e-3)


@pytest.mark.parametrize("e", [0.0, 0.5, 1.0])
def test_rocking_block(e):
    u, b, inertia = 1.0, 1 / 8, (0.25**2 + 1) / 12
    c = collision_at("rocking_block", qpos=[0, 0], qvel=[-u / 2, -u / (2 * b)])
    assert c.labels == ("floor/left", "floor/right")
    np.testing.assert_allclose(c.pre_contact_velocity, [-u, 0], atol=1e-15)
    impulse = u * (1 + e) * inertia / (inertia + b**2)
    for law in (Moreau(e), Newton([e, 0.3])):
        check(law.resolve(c), gamma=[e, 0.7 * (1 + e)], impulse=[impulse, 0], energy=0.49 if e == 0 else None)


def test_rocking_block_comes_upright_with_the_stated_speed():
    model, data = load("rocking_block")
    model.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_ENERGY)
    mujoco.mj_forward(model, data)
    start = data.energy[0]
    upright = collision_at("rocking_block", qpos=[0, 0], qvel=[1 / 8, 1])
    mujoco.mj_resetData(model, data)
    mujoco.mj_forward(model, data)
    assert np.sqrt((start - data.energy[0]) / upright.kinetic_energy) == pytest.approx(1.483425, abs=1e-6)


@pytest.mark.parametrize("e", [0.0, 0.8, 1.0])
def test_juggler(e):
    u = np.sqrt(2 * 9.81 * 0.75)
    assert u == pytest.approx(3.836014, abs=1e-6)
    c = collision_at("juggler", qpos=[0], qvel=[-u])
    check(Newton(e).resolve(c), velocity=[e * u], impulse=[(1 + e) * u / 8], energy=e**2)
    for w in (0.5, (1 - e) / (1 + e) * u):
        moving = Collision(c.mass_matrix, c.jacobian, c.pre_velocity, surface_velocity=[-w])
        check(Newton(e).resolve(moving), velocity=[e * u + (1 + e) * w], impulse=[(1 + e) * (u + w) / 8])
    assert e * u + (1 + e) * w == pytest.approx(u, abs=1e-12)


def test_juggler_falls_on_its_paddle():
    model, data = load("juggler")
    stepper, events, apexes, rising = Stepper(model, "scene"), [], [], False
    while len(apexes) < 2:
        stepper.step(data)
        events += stepper.events
        if rising and data.qvel[0] < 0:
            apexes.append(data.qpos[0] + data.qvel[0] ** 2 / (2 * 9.81))
        rising = data.qvel[0] > 0
    assert events[0].time == pytest.approx(0.391031, abs=1e-6)
    assert events[0].impact.impulse == pytest.approx([0.863103], abs=1e-6)
    assert apexes == pytest.approx([0.48, 0.3072], abs=1e-7)


def test_rocking_platform():
    u, r, b, omega = 1.0, 7 / 10, 1 / 8, 2.0
    c = collision_at("rocking_platform", qpos=[0, 0], qvel=[-u / 2, -4 * u])
    np.testing.assert_allclose(c.pre_contact_velocity, [-u, 0], atol=1e-15)
    turning = Collision(c.mass_matrix, c.jacobian, [-u / 2, omega - 4 * u], surface_velocity=[-b * omega, b * omega])
    np.testing.assert_allclose(turning.pre_contact_velocity, [-u, 0], atol=1e-15)
    for e in (0.0, 0.5, 1.0):
        for collision in (c, turning):
            impulse = [u * (1 + e) * 17 / 20, 0]
            check(Moreau(e).resolve(collision), gamma=[u * e, u * (1 + e) * r], impulse=impulse)
    for collision, energy in ((c, 1), (turning, None)):
        check(Fremond.reversal().resolve(collision), gamma=[0, u], impulse=[u / 2, u / 2], energy=energy)


def test_rocking_platform_that_is_struck():
    """Stepping turns the platform alone: its velocity jumps from 0 to 2 rad/s below the block at rest."""
    b, omega = 1 / 8, 2.0
    model, data = load("rocking_platform")
    data.qvel[:] = 0
    stepper = Stepper(model, Moreau(0.5))
    stepper.step(data)
    assert stepper.events == ()
    turn = omega * model.opt.timestep
    data.mocap_quat[0] = np.cos(turn / 2), 0, np.sin(turn / 2), 0
    stepper.step(data)
    (event,) = stepper.events
    assert event.contacts.labels == ("platform/left",)
    check(event.impact, gamma=[0], impulse=[b * omega * 17 / 20])
    v, q = event.impact.post_velocity
    assert v - b * (q - omega) == pytest.approx(1.7 * b * omega, abs=1e-12)


def test_falling_rod():
    c = collision_at("falling_rod", qpos=[0, 0], qvel=[-1, 0])
    assert c.labels == ("floor/left", "floor/right")
    np.testing.assert_allclose(c.delassus, [[4, -2], [-2, 4]], atol=1e-12)
    check(Newton([1, 0]).resolve(c), velocity=[0.5, 0.5], gamma=[1, 0], impulse=[5 / 6, 2 / 3], energy=1 / 3)
    check(MaximalDissipation().resolve(c), gamma=[0, 0], impulse=[0.5, 0.5], energy=0)
    check(Moreau(1).resolve(c), gamma=[1, 1], impulse=[1, 1], energy=1)
    bounce = collision_at("falling_rod", qpos=[0, 0], qvel=[-0.5, -0.5])
    check(Newton([1, 0]).resolve(bounce), gamma=[1, 0], impulse=[2 / 3, 1 / 3], energy=1)


def test_box_drop():
    u = np.sqrt(2 * 9.81)
    c = collision_at("box_drop", qpos=[0, 0, 0.125, 1, 0, 0, 0], qvel=[0, 0, -u, 0, 0, 0])
    assert c.labels == ("floor/box",) * 4
    assert np.linalg.matrix_rank(c.delassus) == 3
    impact = Moreau(0.5).resolve(c)
    check(impact, velocity=[0, 0, u / 2, 0, 0, 0], impulse=[1.5 * u / 4] * 4, energy=1 / 4)
    assert impact.impulse[0] == pytest.approx(1.661043, abs=1e-6)


def test_ball_stack():
    u = np.sqrt(2 * 9.81 / 8)
    c = collision_at("ball_stack", qpos=[0] * 10, qvel=[-u] * 10)
    assert c.labels == ("floor/ball1", *chain_labels(10))
    impact = Moreau(0.5).resolve(c)
    check(impact, velocity=[u / 2] * 10, impulse=1.5 * u * np.arange(10, 0, -1), energy=1 / 4)
    assert impact.impulse[0] == pytest.approx(23.490690, abs=1e-6)


def test_billiard_rack_break():
    qpos, qvel = np.zeros(32), np.zeros(32)
    qpos[0], qvel[0] = 1.1875, 1.0
    c = collision_at("billiard_rack", qpos, qvel)
    assert c.labels == ("cue/ball1", *TOUCHING["billiard_rack"])
    rows = [
        [(8, 0)],
        [(8, 0)],
        [(5, -3), (5, 3)],
        [(5, -3), (2, 0), (5, 3)],
        [(5, -3), (2, 0), (2, 0), (5, 3)],
        [(6, -2), (2, 0), (2, 0), (2, 0), (6, 2)],
    ]
    p = np.array([ball for row in rows for ball in row]) * [1, np.sqrt(3)] / 70
    dissipated = MaximalDissipation().resolve(c)
    check(dissipated, velocity=p.ravel(), energy=4 / 35)
    assert dissipated.impulse[0] == pytest.approx(0.17 * 31 / 35, abs=1e-12)
    e = 0.95
    impact = Moreau(e).resolve(c)
    check(impact, velocity=(1 + e) * p.ravel() - e * qvel, energy=e**2 + (1 - e**2) * 4 / 35)
    assert impact.post_velocity[0] == pytest.approx(-0.727143, abs=1e-6)

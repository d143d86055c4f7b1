"""The impulses of the law in cfrc_ext, with the convention of MuJoCo's contact forces."""

import copy

import gymnasium
import mujoco
import numpy as np
import pytest
from dm_control import suite
from wrapped import Falling, drop

from impactlaw.envs import ImpactLaw, put_law
from impactlaw.envs.placing.contact_forces import on_bodies
from impactlaw.errors import OptionError, SceneError, SettledError
from impactlaw.scene.contacts import active_contacts, geom_names

G = np.array([0.0, 0.0, -9.81])


class Thrown(Falling):
    """A free body that is thrown at the floor."""

    GEOM = '<geom name="ball" type="sphere" size=".1" mass="2"/>'

    def __init__(self, geom=GEOM, frame_skip=1, velocity=(0, 0, 0, 0, 0, 0), integrator="Euler"):
        option = f'timestep="0.002" integrator="{integrator}" tolerance="1e-15" ls_tolerance="1e-9"'
        xml = f"""<mujoco><option {option}/><worldbody>
          <geom name="floor" type="plane" size="2 2 .1"/>
          <body name="body" pos="0 0 .3"><freejoint/>{geom}</body></worldbody></mujoco>"""
        self._velocity = velocity
        self.metadata = {"render_modes": [], "render_fps": round(500 / frame_skip)}
        super().__init__(xml=xml, frame_skip=frame_skip)

    def reset_model(self):
        self.set_state(self.init_qpos, np.array(self._velocity, dtype=float))
        return self.data.qpos.copy()


BALL = Thrown.GEOM
CAPSULE = '<geom type="capsule" size=".05 .1" euler="70 20 0" mass="2" condim="{}" friction=".6 .02 .01"/>'


def momentum(env):
    data = env.unwrapped.data
    return 2.0 * data.qvel[:3]


def fall(env, steps):
    """Return the force on the body and the change of its momentum in each step."""
    env.reset(seed=0)
    force, change = [], []
    for _ in range(steps):
        before = momentum(env).copy()
        env.step(np.zeros(0))
        force.append(env.unwrapped.data.cfrc_ext[1, 3:].copy())
        change.append(momentum(env) - before)
    return np.array(force), np.array(change), env.unwrapped.dt


@pytest.mark.parametrize("restitution", [0.0, 0.5, 1.0])
def test_the_forces_on_a_ball_that_is_dropped_are_its_change_of_momentum(restitution):
    """``dt sum(F) = m (v - v0) - m g t`` over the landing, and in each of its steps."""
    env = ImpactLaw(Thrown(), "moreau", restitution, impulse_in_cfrc_ext=True)
    force, change, dt = fall(env, 150)
    np.testing.assert_allclose(force * dt, change - 2.0 * G * dt, atol=1e-12)
    assert (force * dt)[:, 2].max() > 2.0 * (1.0 + restitution) * 1.9  # it landed with 1.98 m/s
    without = fall(ImpactLaw(Thrown(), "moreau", restitution), 150)[0]
    assert np.abs(without * dt)[:, 2].max() < 0.5


@pytest.mark.parametrize("condim", [1, 3, 4, 6])
def test_friction_is_in_it(condim):
    """A tilted capsule lands and slides, rolls and turns: forces match its change of momentum in all directions."""
    body = Thrown(CAPSULE.format(condim), velocity=(1.0, 0.5, -2.0, 3.0, -1.0, 2.0))
    env = ImpactLaw(body, "moreau", 0.3, impulse_in_cfrc_ext=True)
    force, change, dt = fall(env, 250)
    np.testing.assert_allclose(force * dt, change - 2.0 * G * dt, atol=1e-9)
    if condim > 1:
        assert np.abs(force[:, :2]).max() > 10.0


@pytest.mark.parametrize("condim", [1, 3, 6])
def test_torques_are_changes_of_angular_momentum(condim):
    """About the centre of mass, ``dL = h tau`` in the step of the landing, up to gyroscopic forces."""
    env = ImpactLaw(
        Thrown(CAPSULE.format(condim), velocity=(0.5, 0.2, -3.0, 0.0, 0.0, 0.0)),
        "moreau",
        0.8,
        impulse_in_cfrc_ext=True,
    )
    env.reset(seed=0)
    model, data = env.unwrapped.model, env.unwrapped.data
    while True:  # it turns only after the collision
        before = data.qvel.copy()
        env.step(np.zeros(0))
        if env.events:
            break
    M = np.zeros((6, 6))
    mujoco.mj_fullM(model, data, M)  # at the start of the step
    R = data.xmat[1].reshape(3, 3)
    change = R @ (M @ (data.qvel - before))[3:]
    gyroscopic = np.abs(data.qvel[3:]).max() ** 2 * np.diag(M)[3:].max() * env.unwrapped.dt
    np.testing.assert_allclose(data.cfrc_ext[1, :3] * env.unwrapped.dt, change, atol=gyroscopic)
    assert np.abs(change).max() > 20 * gyroscopic


@pytest.mark.parametrize("name", ["Ant-v5", "Humanoid-v5"])
def test_the_convention_is_mujocos(name):
    """MuJoCo's contact forces, passed like impulses of a law, lead to MuJoCo's own cfrc_ext."""
    env = gymnasium.make(name).unwrapped
    env.reset(seed=0)
    model, data = env.model, env.data
    for _ in range(200):
        mujoco.mj_step(model, data)
    mujoco.mj_forward(model, data)
    mujoco.mj_rnePostConstraint(model, data)
    contacts = active_contacts(model, data, geom_names(model))
    assert len(contacts) >= 2
    force, torque = np.zeros((2, len(contacts), 3))
    taken = set()
    for i, (geoms, position) in enumerate(zip(contacts.geoms, contacts.position, strict=True)):
        for j, found in enumerate(data.contact):
            if j not in taken and set(found.geom) == set(geoms) and (found.pos == position).all():
                taken.add(j)
                six = np.zeros(6)
                mujoco.mj_contactForce(model, data, j, six)
                sign = 1.0 if found.geom[0] == geoms[0] else -1.0
                axes = found.frame.reshape(3, 3)
                force[i], torque[i] = sign * axes.T @ six[:3], sign * axes.T @ six[3:]
                break
    np.testing.assert_allclose(on_bodies(model, data, contacts, force, torque), data.cfrc_ext, atol=1e-9)
    assert np.abs(data.cfrc_ext).max() > 1.0


@pytest.mark.parametrize("skip", [1, 4, 10])
def test_impulses_of_all_timesteps_of_a_step_count(skip):
    """In whichever timestep the ball lands, its impulse over the duration of the step is added."""
    env = ImpactLaw(Thrown(frame_skip=skip), "moreau", 0.5, impulse_in_cfrc_ext=True)
    plain = ImpactLaw(Thrown(frame_skip=skip), "moreau", 0.5)
    env.reset(seed=0), plain.reset(seed=0)
    total, wanted = 0.0, 0.0
    for _ in range(200 // skip):
        env.step(np.zeros(0)), plain.step(np.zeros(0))
        more = env.unwrapped.data.cfrc_ext - plain.unwrapped.data.cfrc_ext
        impulse = sum(event.impact.impulse.sum() for event in env.events)
        assert more[1, 5] * env.unwrapped.dt == pytest.approx(impulse, abs=1e-12)
        assert (env.unwrapped.data.qpos == plain.unwrapped.data.qpos).all()
        total, wanted = total + more[1, 5] * env.unwrapped.dt, wanted + impulse
    assert total == pytest.approx(wanted)
    assert wanted > 5.0


def test_without_a_collision_nothing_changes():
    """Observations and rewards, with cfrc_ext, are MuJoCo's, bit for bit."""
    env = ImpactLaw(gymnasium.make("Ant-v5"), "moreau", 0.5, impulse_in_cfrc_ext=True, rest_speed=1e9)
    plain = gymnasium.make("Ant-v5")
    env.reset(seed=0), plain.reset(seed=0)
    env.action_space.seed(0)
    for _ in range(60):
        action = env.action_space.sample()
        one, other = env.step(action), plain.step(action)
        np.testing.assert_array_equal(one[0], other[0])
        assert one[1] == other[1]


def landing(env):
    """Return the largest contact cost of an Ant that is dropped from 1.5 m, averaged over postures."""
    largest = []
    for seed in range(8):
        env.reset(seed=seed)
        base, rng = env.unwrapped, np.random.default_rng(seed)
        qpos = base.init_qpos.copy()
        qpos[2], qpos[7:] = 1.5, qpos[7:] + rng.uniform(-0.3, 0.3, 8)
        qpos[3:7] += 0.1 * rng.normal(size=4)
        base.set_state(qpos, np.zeros(base.model.nv))
        largest.append(max(-env.step(np.zeros(8))[4]["reward_contact"] for _ in range(25)))
    return np.mean(largest)


def test_ant_pays_for_a_hard_landing():
    """The cost has the order of MuJoCo's; without the impulses it is a tenth."""
    options = {"contact_cost_weight": 1e-6, "contact_force_range": (-1e6, 1e6), "terminate_when_unhealthy": False}
    mujocos = landing(gymnasium.make("Ant-v5", **options))
    free = landing(ImpactLaw(gymnasium.make("Ant-v5", **options), "moreau", 0.0))
    paid = landing(ImpactLaw(gymnasium.make("Ant-v5", **options), "moreau", 0.0, impulse_in_cfrc_ext=True))
    assert free < 0.2 * mujocos
    assert 0.4 * mujocos < paid < 2.0 * mujocos


@pytest.mark.parametrize("skip", [1, 5])
def test_rigid_time_stepping_has_the_mean_of_all_timesteps(skip):
    env = ImpactLaw(
        Thrown(frame_skip=skip, velocity=(1, 0, 0, 0, 0, 0)),
        "moreau",
        0.5,
        contact_model="rigid",
        impulse_in_cfrc_ext=True,
    )
    force, change, dt = fall(env, 300 // skip)
    np.testing.assert_allclose(force * dt, change - 2.0 * G * dt, atol=1e-9)
    assert force[:, 2].max() * dt > 5.0


@pytest.mark.parametrize("integrator", ["implicitfast", "RK4"])
def test_other_integrators(integrator):
    env = ImpactLaw(Thrown(integrator=integrator), "moreau", 0.5, impulse_in_cfrc_ext=True)
    plain = ImpactLaw(Thrown(integrator=integrator), "moreau", 0.5)
    env.reset(seed=0), plain.reset(seed=0)
    for _ in range(150):
        env.step(np.zeros(0)), plain.step(np.zeros(0))
        more = (env.unwrapped.data.cfrc_ext - plain.unwrapped.data.cfrc_ext)[1, 5] * env.unwrapped.dt
        assert more == pytest.approx(sum(event.impact.impulse.sum() for event in env.events), abs=1e-12)


@pytest.mark.parametrize(
    "make", [lambda: suite.load("hopper", "hop", {"random": 0}), lambda: drop()], ids=["suite", "composer"]
)
def test_in_dm_control(make):
    env = make()
    placed = put_law(env, "moreau", 0.5, impulse_in_cfrc_ext=True)
    env.reset()
    seen = 0
    for _ in range(60):
        env.step(np.zeros(env.action_spec().shape))
        model, data = env.physics.model.ptr, env.physics.data.ptr
        law = {body: np.zeros(3) for body in range(model.nbody)}
        for event in placed.events:
            for geoms, normal, impulse in zip(
                event.contacts.geoms, event.contacts.normal, event.impact.impulse, strict=True
            ):
                seen += 1
                for sign, geom in ((-1, geoms[0]), (1, geoms[1])):
                    if geom >= 0:
                        law[model.geom_bodyid[geom]] += sign * impulse * normal
        duration = env.control_timestep()
        for body in range(1, model.nbody):
            if np.linalg.norm(law[body]) > 0.1 and model.nv == 6:
                assert data.cfrc_ext[body, 5] * duration >= 0.9 * law[body][2]
    assert seen > 0
    assert np.isfinite(env.physics.data.ptr.cfrc_ext).all()


def test_copies_keep_it():
    env = ImpactLaw(Thrown(), "moreau", 0.5, impulse_in_cfrc_ext=True)
    env.reset(seed=0)
    twin = copy.deepcopy(env)
    one, other = ([e.step(np.zeros(0)) and e.unwrapped.data.cfrc_ext[1, 5] for _ in range(120)] for e in (env, twin))
    assert one == other
    assert max(one) > 1000.0
    ant = ImpactLaw(gymnasium.make("Ant-v5"), "moreau", 0.5, contacts="*", limits=False, impulse_in_cfrc_ext=True)
    again = gymnasium.make(gymnasium.envs.registration.EnvSpec.from_json(ant.spec.to_json()))
    assert (again.contacts, again.limits, again.impulse_in_cfrc_ext) == ("*", False, True)


def test_what_means_nothing_is_refused():
    options = {"contact_model": "rigid", "scheme": "event-driven"}
    with pytest.raises(SceneError, match="means nothing to event-driven steps"):
        ImpactLaw(Falling(), "moreau", 0.5, impulse_in_cfrc_ext=True, **options)
    env = ImpactLaw(Falling(), "moreau", 0.5, impulse_in_cfrc_ext=True, contact_model="rigid")
    with pytest.raises(SceneError, match="means nothing to event-driven steps"):
        env.reset(options={"scheme": "event-driven"})
    with pytest.raises(OptionError, match="True or False"):
        ImpactLaw(Falling(), "moreau", 0.5, impulse_in_cfrc_ext="yes")
    with pytest.raises(SettledError):
        env.impulse_in_cfrc_ext = False

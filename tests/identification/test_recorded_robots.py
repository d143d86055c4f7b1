"""Laws are fitted again to recordings of robots: planar, with joint limits, with dependent contacts."""

from __future__ import annotations

import gymnasium
import mujoco
import numpy as np
import pytest
from identification.tables import run_cli, table
from laws.frictional import one_contact

from impactlaw import Collision, Coulomb, Moreau, Newton, Stepper
from impactlaw.envs import ImpactLaw
from impactlaw.identification import audit, cross_validate, fit, read_collisions
from impactlaw.identification.contact_space import collision_of
from impactlaw.identification.families import with_friction
from impactlaw.recording import Recorder


@pytest.mark.parametrize("contact_model", ["soft", "rigid"])
def test_a_robot_that_moves_in_a_plane(tmp_path, contact_model):
    """No impulse moves it out of the plane, so these rows of friction are zero. Joint limits have no friction.

    In this episode no foot rises while it still touches and another contact collides. Steppers aim at 0 for such a
    foot, the families of laws below 0.
    """
    env = ImpactLaw(
        gymnasium.make("HalfCheetah-v5"), "moreau", 0.5, contact_model=contact_model, log=tmp_path / "run.rrd"
    )
    env.reset(seed=3)
    env.action_space.seed(3)
    for _ in range(30):
        env.step(env.action_space.sample())
    env.close()
    measured = read_collisions(tmp_path / "run.rrd")
    assert len({len(c.labels) for c in measured.collisions}) > 1
    found = fit(*measured, "coulomb")
    assert found.parameters == pytest.approx({"restitution": 0.5, "friction": 0.4}, abs=1e-4)
    assert found.rms < 1e-4


BALLS = """<mujoco><option timestep="0.005"/><worldbody>
  <geom name="floor" type="plane" size="9 9 1" friction="0 0 0"/>
  <body pos="0 0 .5"><freejoint/><geom size=".1" condim="4" friction=".05 .01 0"/></body>
  <body pos="1 0 .5"><freejoint/><geom size=".1" condim="6" friction=".2 .02 .005"/></body></worldbody></mujoco>"""


def test_contacts_with_friction_of_their_own(tmp_path):
    """The ratios of sliding, torsional and rolling coefficients are the same for all contacts: one number is fitted."""
    model = mujoco.MjModel.from_xml_string(BALLS)
    data, rng = mujoco.MjData(model), np.random.default_rng(0)
    stepper = Stepper(model, Moreau(0.6), scheme="time-stepping")
    with Recorder(model, tmp_path / "run.rrd", law=stepper.law) as recorder:
        for i in range(600):
            if i % 150 == 0:
                mujoco.mj_resetData(model, data)
                data.qvel[:] = rng.normal(size=12) * np.tile([4, 4, 1, 20, 20, 20], 2)
            stepper.step(data)
            recorder.step(data, stepper.events)
    found = fit(*read_collisions(tmp_path / "run.rrd"), "coulomb")
    assert found.parameters == pytest.approx({"restitution": 0.6, "friction": 0.2}, abs=1e-4)
    assert found.largest == pytest.approx(0.2)


def test_collisions_that_tell_nothing(tmp_path, monkeypatch, capsys):
    """Contacts that only open do not determine restitution, and sticking contacts do not determine friction."""
    opened = [{"contacts": ["a/b"], "pre_contact_velocity": [v], "post_contact_velocity": [v]} for v in (0.5, 1.0)]
    code, _, said = run_cli(
        monkeypatch, capsys, "identify", table(tmp_path / "open.csv", opened), "--out", tmp_path / "l.json"
    )
    assert code == 2
    assert "no collision changes a velocity" in said
    assert not (tmp_path / "l.json").exists()
    noisy = [
        {"contacts": ["a/b"], "pre_contact_velocity": [v], "post_contact_velocity": [1.05 * v]} for v in (0.5, 0.7, 1.0)
    ]
    path = table(tmp_path / "noisy.csv", noisy)
    code, _, said = run_cli(monkeypatch, capsys, "identify", path, "--out", tmp_path / "l.json")
    assert code == 2
    assert "no family fits" in said
    assert not (tmp_path / "l.json").exists()
    G = [[1.0, 0.0], [0.0, 1.0]]
    stuck = [
        {"contacts": ["a/b"], "pre_contact_velocity": [-v], "post_contact_velocity": [0.5 * v], "delassus": G,
         "pre_sliding_velocity": [0.01 * v], "post_sliding_velocity": [0.0], "friction_contact": [0]}
        for v in (0.5, 1.0, 2.0)
    ]  # fmt: skip
    path = table(tmp_path / "stuck.csv", stuck)
    code, shown, _ = run_cli(monkeypatch, capsys, "identify", path, "--family", "coulomb", "--out", tmp_path / "l.json")
    assert code == 0
    assert "friction 0.3000 (?)" in shown
    assert "(?): at a bound, or the collisions do not tell this number" in shown


def test_an_audit_tells_the_friction_beside_limits_of_joints():
    sliding = [with_friction(one_contact(np.random.default_rng([2, i])), 0.3) for i in range(20)]
    limits = [Collision(c.mass_matrix, c.jacobian[:1], c.pre_velocity) for c in sliding[:5]]
    after = [Coulomb(Newton(0.5)).resolve(c).post_velocity for c in sliding + limits]
    cause = audit([*(with_friction(c, 0.02) for c in sliding), *limits], after).likely_causes[0]
    assert (cause.name, cause.value) == ("friction", 0.3)


def test_contacts_that_hardly_move_apart():
    """Impulses change the second contact velocity by 1e-9 of the change of the first one."""
    J, v = np.array([[1.0, 0.0], [1.0, 1e-5]]), np.array([-1.0, 3.0])
    c = Collision(np.eye(2), J, v, labels=("a", "b"))
    impact = Newton(0.6).resolve(c)
    after = impact.post_contact_velocity
    read, post = collision_of(J @ J.T, J @ v, after, c.labels, np.zeros(0, int), np.zeros(0))
    np.testing.assert_allclose(read.pre_contact_velocity, J @ v, atol=1e-9)
    np.testing.assert_allclose(read.contact_velocity_after(post), after, atol=1e-9)
    np.testing.assert_allclose(Newton(0.6).resolve(read).post_velocity, post, atol=1e-4)


def test_what_no_impulse_changes_is_a_velocity_of_surfaces():
    """A body on a rail along x hits a floor whose friction has no component along the rail."""
    G, contact, mu = np.diag([2.0, 0.0, 3.0]), np.array([0, 0]), np.array([0.5, 0.5])
    before, after = np.array([-1.0, 0.7, 0.2]), np.array([0.5, 0.7, 0.1])
    c, post = collision_of(G, before, after, ("floor",), contact, mu)
    assert c.friction is not None
    np.testing.assert_allclose(c.pre_contact_velocity, before[:1])
    np.testing.assert_allclose(c.pre_sliding_velocity, before[1:])
    np.testing.assert_allclose(c.friction.jacobian @ post + c.friction.surface_velocity, after[1:])
    assert c.friction.surface_velocity.tolist() == pytest.approx([0.7, 0.0])


@pytest.mark.parametrize("family", ["newton", "poisson", "compliant"])
def test_a_contact_that_one_fold_alone_has(family):
    """In the fold whose law has not seen the contact, its coefficient is the starting value of the search."""
    rng, collisions = np.random.default_rng(0), []
    for i in range(12):
        labels = ("rare",) if i == 5 else ("often",) if i % 2 else ("other",)
        G, none = np.array([[1.0]]), np.zeros(0, int)
        speed = np.array([-rng.uniform(0.5, 1.0)])
        collisions.append(collision_of(G, speed, -0.7 * speed, labels, none, np.zeros(0))[0])
    after = [Newton(0.7).resolve(c).post_velocity for c in collisions]
    checked = cross_validate(collisions, after, family, folds=4)
    assert np.sort(checked.fold_rms)[:3] == pytest.approx(0.0, abs=1e-6)
    assert checked.fold_rms.max() < 0.3

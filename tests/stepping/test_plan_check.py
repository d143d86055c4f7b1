"""Features that a scene lacks when its stepper is made but has later: steps refuse to continue without them."""

import copy

import mujoco
import numpy as np
import pytest
from scenes import WAYS, compiled

from impactlaw import Moreau, Stepper
from impactlaw.batch import Batch
from impactlaw.cli import main
from impactlaw.errors import SceneError
from impactlaw.stepping import plan_check
from impactlaw.stepping.plan import make_plan

every_way = pytest.mark.parametrize("way", WAYS)
OVERRIDE = '<option o_friction=".1 .1 .005 .0001 .0001"><flag override="enable"/></option>'


def block(geom):
    """Return a block that slides on a floor at 2 m/s; both geoms have these attributes."""
    model, data = compiled(f"""<geom type="plane" size="9 9 1" {geom}/>
      <body pos="0 0 .1"><freejoint/><geom type="box" size=".1 .1 .1" mass="1" {geom}/></body>""")
    data.qvel[0] = 2.0
    return model, data


def give_friction(model):
    model.geom_friction[:, 0] = 0.5


def give_directions(model):
    model.geom_condim[:] = 3


def let_meet(model):
    model.geom_contype[:] = model.geom_conaffinity[:] = model.body_contype[:] = model.body_conaffinity[:] = 1


CHANGES = {
    "friction": ('friction="0 0 0"', give_friction, "contacts have friction since model.geom_friction"),
    "condim": ('condim="1"', give_directions, "contacts have friction since model.geom_condim"),
    "contact": ('contype="0" conaffinity="0"', let_meet, "geoms can meet since model.geom_contype"),
}


@every_way
@pytest.mark.parametrize("change", CHANGES)
def test_friction_and_contact_that_come_later(way, change):
    geom, apply, words = CHANGES[change]
    model, data = block(geom)
    stepper = Stepper(model, Moreau(0.5), **WAYS[way])
    stepper.step(data)
    apply(model)
    for _ in range(2):
        with pytest.raises(SceneError, match=f"{words} was changed.* make a new Stepper"):
            stepper.step(data)
    Stepper(model, Moreau(0.5), **WAYS[way]).step(mujoco.MjData(model))


@every_way
def test_changes_that_need_nothing_new(way):
    model, data = block('friction="0 0 0"')
    stepper = Stepper(model, Moreau(0.5), **WAYS[way])
    model.geom_friction[0, 1] = 1e-12
    stepper.step(data)
    ignoring = Stepper(model, Moreau(0.5), friction="ignore", **WAYS[way])
    give_friction(model)
    ignoring.step(data)
    assert data.qvel[0] > 1.9 or way.startswith("soft")


def test_a_copy_looks_at_its_own_model():
    model, data = block('friction="0 0 0"')
    stepper = Stepper(model, Moreau(0.5), scheme="time-stepping")
    other = copy.deepcopy(stepper)
    give_friction(other.model)
    stepper.step(data)
    for one in (other, copy.deepcopy(other)):  # a copy of a stepper that has not seen the change yet
        with pytest.raises(SceneError, match="contacts have friction"):
            one.step(mujoco.MjData(one.model))


rigid_ways = pytest.mark.parametrize("way", [way for way in WAYS if not way.startswith("soft")])


@rigid_ways
@pytest.mark.parametrize(
    ("name", "value", "lost"), [("geom_friction", 0.1, 0.981), ("geom_friction", 1.0, 9.81), ("geom_condim", 1, 0.0)]
)
def test_friction_that_is_changed_later(way, name, value, lost):
    """A sliding block loses the speed mu g t, with the current mu."""
    model, data = block('friction="0.3"')
    stepper = Stepper(model, Moreau(0.0), **WAYS[way])
    stepper.step(data, 50)
    before, start = data.qvel[0], data.time
    getattr(model, name)[:] = value if name == "geom_condim" else (value, 0.005, 0.0001)
    stepper.step(data, 50)
    assert before - data.qvel[0] == pytest.approx(lost * (data.time - start), abs=1e-9)


@rigid_ways
def test_what_rests_on_a_slope_slides_when_friction_is_taken_away(way):
    model, data = block('friction="1"')
    data.qvel[0], model.opt.gravity[:] = 0.0, (6.0, 0.0, -8.0)
    stepper = Stepper(model, Moreau(0.0), **WAYS[way])
    stepper.step(data, 20)
    assert abs(data.qvel[0]) < 1e-9
    model.geom_friction[:, 0] = 0.5
    stepper.step(data, 50)
    assert data.qvel[0] == pytest.approx((6.0 - 0.5 * 8.0) * 50 * model.opt.timestep, abs=1e-6)


def no_contact(model):
    model.geom_contype[:] = model.body_contype[:] = 0
    model.geom_conaffinity[:] = model.body_conaffinity[:] = 0


def lower_table(model):
    model.body_pos[1, 2] = -0.2


def thinner(model):
    model.geom_size[1, 2] = 0.05


@rigid_ways
@pytest.mark.parametrize(("change", "falls"), [(no_contact, 1.0), (lower_table, 0.2), (thinner, 0.05)])
def test_what_rests_falls_when_what_carries_it_is_changed(way, change, falls):
    model, data = compiled("""<body><geom type="box" size="1 1 .1"/></body>
      <body pos="0 0 .2"><freejoint/><geom type="box" size=".1 .1 .1"/></body>""")
    stepper = Stepper(model, Moreau(0.0), **WAYS[way])
    stepper.step(data, 20)
    assert data.qpos[2] == pytest.approx(0.2, abs=1e-9)
    change(model)
    while data.qpos[2] > 0.2 - falls + 1e-4:
        stepper.step(data)
        assert data.time < 2.0


ARM = '<body pos="0 {} 1"><joint axis="0 1 0" range="-30 30" limited="{}"/><geom size=".1" pos=".4 0 0"/></body>'


@pytest.mark.parametrize("limited", ["false", "true"])
def test_limits_that_come_later(limited):
    for way, options in WAYS.items():
        model, data = compiled(ARM.format(0, "false") + ARM.format(5, limited))
        stepper = Stepper(model, Moreau(0.0), **options)
        model.jnt_limited[0], model.jnt_range[0] = 1, (-0.1, 0.1)
        if way == "event-driven":
            with pytest.raises(SceneError, match=r"model.jnt_limited was changed"):
                stepper.step(data)
            continue
        stepper.step(data, 300)
        assert abs(data.qpos[0]) < 0.11


@pytest.mark.parametrize("way", [way for way in WAYS if way != "event-driven"])
def test_limits_that_come_later_where_nothing_else_is_met(way):
    ends = []
    for limited in (True, False):
        model, data = compiled(
            f'''<body pos="0 0 1"><joint axis="0 1 0" range="-30 30" limited="{str(limited).lower()}"/>
              <geom size=".1" pos=".4 0 0" contype="0" conaffinity="0"/></body>'''
        )
        stepper = Stepper(model, Moreau(0.9), **WAYS[way])
        model.jnt_limited[0], model.jnt_range[0] = 1, (-0.5, 0.5)
        stepper.step(data, 400)
        ends.append(data.qpos[0])
    assert ends[0] == ends[1]


def test_a_range_that_is_changed_later():
    model, data = compiled(ARM.format(0, "true"))
    stepper = Stepper(model, Moreau(0.0))
    stepper.step(data)
    model.jnt_range *= 0.5
    with pytest.raises(SceneError, match=r"model.jnt_range was changed, but event-driven steps keep"):
        stepper.step(data)


BELTS = """<geom name="belt" type="plane" size="9 9 1" friction="0.5"/>
  <geom type="box" size="1 1 1" pos="50 0 0" {} contype="0" conaffinity="0"/>
  <body pos="0 0 .1"><freejoint/><geom type="box" size=".1 .1 .1" mass="1" friction="0.5"/></body>"""
TABLE = '<body mocap="true" pos="9 0 5"><geom size=".1"/></body>'


@pytest.mark.parametrize("way", ["soft", "soft in Python", "event-driven"])
def test_belts_that_come_later(way):
    model, data = compiled(BELTS.format('surfacevel="1 0 0 0 0 0"'))
    stepper = Stepper(model, Moreau(0.0), **WAYS[way])
    stepper.step(data)
    model.geom_surfacevel[0, 0] = 1.0
    with pytest.raises(SceneError, match=r"surfaces move since model.geom_surfacevel"):
        stepper.step(data)


@every_way
def test_belts_that_start_later_among_surfaces_that_move(way):
    model, data = compiled(BELTS.format('surfacevel="1 0 0 0 0 0"') + TABLE)
    data.qpos[2], data.qvel[2] = 0.3, -3.0
    stepper = Stepper(model, Moreau(0.0), **WAYS[way])
    stepper.step(data)
    model.geom_surfacevel[0, 0] = 1.0
    stepper.step(data, 400)
    assert data.qvel[0] == pytest.approx(1.0, abs=1e-6)


@every_way
@pytest.mark.parametrize("more", ["", TABLE])
@pytest.mark.parametrize("early", [True, False])
def test_what_is_written_into_a_model_without_belts_is_ignored_as_in_mujoco(way, more, early):
    model, data = compiled(BELTS.format("") + more)
    data.qpos[2], data.qvel[2] = 0.3, -3.0
    if early:
        model.geom_surfacevel[0, 0] = 1.0
    stepper = Stepper(model, Moreau(0.0), **WAYS[way])
    stepper.step(data)
    model.geom_surfacevel[0, 0] = 1.0
    stepper.step(data, 200)
    assert abs(data.qvel[0]) < 1e-9


@every_way
def test_friction_of_the_override(way):
    """The override applies to all of MuJoCo's contacts: soft steps use it, rigid steps refuse it."""
    model, data = block('friction="0 0 0"')
    model.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_OVERRIDE)
    model.opt.o_friction[:] = 0.1, 0.1, 0.005, 0.0001, 0.0001
    if not way.startswith("soft"):
        with pytest.raises(SceneError, match=r"o_friction.* set the friction of geoms and pairs"):
            Stepper(model, Moreau(0.0), **WAYS[way])
        Stepper(model, Moreau(0.0), friction="ignore", **WAYS[way]).step(data)
        return
    data.qpos[2], data.qvel[2] = 0.101, -3.0
    stepper = Stepper(model, Moreau(0.0), **WAYS[way])
    while not stepper.events:
        stepper.step(data)
    (event,) = stepper.events
    np.testing.assert_allclose(event.impact.post_velocity[0], 2.0 - 0.1 * 3.0, rtol=0, atol=0.01)


@pytest.mark.parametrize("way", ["time-stepping", "event-driven"])
@pytest.mark.parametrize("friction", ["coulomb", "convex", "ignore"])
def test_the_override_that_comes_later(way, friction):
    """It is refused where contacts have friction, and only while it is on."""
    model, data = block("")
    stepper = Stepper(model, Moreau(0.0), friction=friction, **WAYS[way])
    stepper.step(data)
    model.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_OVERRIDE)
    time = data.time
    if friction == "ignore":
        stepper.step(data)
    else:
        with pytest.raises(SceneError, match="o_friction"):
            stepper.step(data)
        assert data.time == time
    model.opt.enableflags = 0
    stepper.step(data)
    assert data.time > time


def test_friction_of_the_override_in_a_batch_and_a_plan(tmp_path, monkeypatch, capsys):
    model, _ = block('friction="0 0 0"')
    model.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_OVERRIDE)
    with pytest.raises(SceneError, match="o_friction"):
        Batch(model, Moreau(0.0), 2, 1)
    path = tmp_path / "scene.xml"
    balls = '<geom size=".1"/><body><freejoint/><geom size=".1"/></body>'
    path.write_text(f"<mujoco>{OVERRIDE}<worldbody>{balls}</worldbody></mujoco>")
    monkeypatch.setattr("sys.argv", ["impactlaw", "plan", str(path)])
    with pytest.raises(SystemExit):
        main()
    assert "o_friction" in capsys.readouterr().err


@every_way
def test_a_child_that_comes_to_meet_its_parent(way):
    """MuJoCo excludes parents and children, unless a flag is set; event-driven steps would let them pass."""
    model, data = compiled("""<body><joint type="slide" axis="1 0 0"/><geom size=".1"/>
      <body pos="0 0 .5"><joint type="slide" axis="0 0 1"/><geom size=".1"/></body></body>""")
    stepper = Stepper(model, Moreau(0.5), **WAYS[way])
    stepper.step(data)
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_FILTERPARENT)
    with pytest.raises(SceneError, match=r"geoms can meet since model.opt.disableflags was changed"):
        stepper.step(data)


@every_way
def test_a_flag_that_is_changed_once_is_looked_at_once(way, monkeypatch):
    model, data = block('contype="0" conaffinity="0"')
    stepper, made = Stepper(model, Moreau(0.5), **WAYS[way]), []

    def counted(*given, **options):
        made.append(given)
        return make_plan(*given, **options)

    monkeypatch.setattr(plan_check, "make_plan", counted)
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_FILTERPARENT)
    for _ in range(3):
        stepper.step(data)
    assert len(made) == 1


@every_way
def test_geoms_with_friction_that_meet_others_later(way):
    """Geoms without friction can collide already."""
    model, data = compiled("""<geom type="plane" size="9 9 1" condim="1"/><body pos="0 0 .1"><freejoint/>
      <geom type="box" size=".1 .1 .1" mass="1" condim="1"/>
      <geom size=".05" pos="0 0 -.05" mass="0" condim="3" contype="0" conaffinity="0"/></body>""")
    stepper = Stepper(model, Moreau(0.0), **WAYS[way])
    stepper.step(data)
    let_meet(model)
    with pytest.raises(SceneError, match=r"contacts have friction since model.geom_con"):
        stepper.step(data)


def test_coefficients_of_friction_count_once_a_condim_lets_them():
    model, data = block('condim="1" friction="0 0 0"')
    stepper = Stepper(model, Moreau(0.5))
    model.geom_friction[:, 0] = 0.5
    stepper.step(data)
    model.geom_friction[:, 0] = 0.0
    model.geom_condim[:] = 3
    stepper.step(data)
    model.geom_friction[:, 0] = 0.5
    with pytest.raises(SceneError, match=r"contacts have friction since model.geom_friction was changed"):
        stepper.step(data)


@pytest.mark.parametrize("way", [{"contact_model": "soft"}, {"scheme": "event-driven"}])
def test_a_belt_switched_on_later_is_refused_where_the_plan_has_none(way):
    """MuJoCo reads the velocity of belts only if the model was compiled with one, or the flag is set by hand."""
    model = mujoco.MjModel.from_xml_string("""
    <mujoco>
      <worldbody>
        <geom type="plane" size="1 1 1"/>
        <body pos="0 0 .1"><freejoint/><geom size=".1"/></body>
      </worldbody>
    </mujoco>""")
    data, stepper = mujoco.MjData(model), Stepper(model, Moreau(0.5), **way)
    stepper.step(data)
    model.geom_surfacevel[0, 0], model.flg_surfacevel = 1.0, True
    with pytest.raises(SceneError, match="surfaces move since"):
        stepper.step(data)

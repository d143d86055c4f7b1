"""Every scene follows the conventions, starts without overlap, and is found by name; files that are not scenes."""

from pathlib import Path

import mujoco
import numpy as np
import pytest
from scenes import TOUCHING, detect, label

from impactlaw import read_contacts
from impactlaw.errors import DivergenceError, SceneError, UnknownNameError
from impactlaw.models import SCENES, load, scene_names, scene_path


def test_the_scenes_are_these():
    assert set(scene_names()) == set(SCENES) == set(TOUCHING)
    assert scene_names() == tuple(sorted(SCENES))


@pytest.mark.parametrize("name", scene_names())
def test_conventions(name):
    model, data = load(name)
    assert scene_path(name).read_text().startswith("<!--\n")
    assert len(SCENES[name]) > 10
    assert "\n" not in SCENES[name]
    assert mujoco.mj_name2id(model, int(mujoco.mjtObj.mjOBJ_KEY), "start") >= 0
    np.testing.assert_array_equal(data.qpos, model.key("start").qpos)
    np.testing.assert_array_equal(data.qvel, model.key("start").qvel)
    assert 0 <= model.numeric("restitution").data[0] <= 1
    assert 0 < model.numeric("duration").data[0] <= 10
    assert model.nlight >= 1
    assert model.camera("main").id >= 0


@pytest.mark.parametrize("name", scene_names())
def test_only_what_is_needed(name):
    model, _ = load(name)
    collides = (model.geom_contype != 0) | (model.geom_conaffinity != 0)
    assert (model.geom_condim[collides] == 1).all()
    assert model.nu == model.nsensor == model.ntex == model.neq == model.ntendon == model.nsite == 0
    for kind, count in (("body", model.nbody), ("joint", model.njnt), ("geom", model.ngeom)):
        assert all(getattr(model, kind)(i).name for i in range(count)), kind


@pytest.mark.parametrize("name", scene_names())
def test_restitution_names_existing_geoms(name):
    model, _ = load(name)
    for i in range(model.nnumeric):
        key, *geoms = model.numeric(i).name.split("/")
        if key == "restitution" and geoms:
            assert len(geoms) == 2
            assert all(model.geom(geom).id >= 0 for geom in geoms)
            assert 0 <= model.numeric(i).data[0] <= 1


@pytest.mark.parametrize("name", scene_names())
def test_start_touches_without_overlap(name):
    model, data = load(name)
    contacts = detect(model, data)
    assert sorted(label(model, c) for c in contacts) == sorted(TOUCHING[name])
    assert all(abs(c.dist) < 1e-15 for c in contacts)
    assert all(c.dim == 1 for c in contacts)


@pytest.mark.parametrize("name", scene_names())
def test_camera_sees_every_moving_body(name):
    model, data = load(name)
    mujoco.mj_forward(model, data)
    camera = model.camera("main")
    moving = model.geom_bodyid[model.body_dofnum[model.geom_bodyid] > 0]
    view = (data.xipos[moving] - data.cam("main").xpos) @ data.cam("main").xmat.reshape(3, 3)
    height = -view[:, 2] * np.tan(np.radians(camera.fovy[0]) / 2)
    assert (view[:, 2] < 0).all()
    assert (abs(view[:, 1]) < 0.95 * height).all()
    assert (abs(view[:, 0]) < 0.95 * height * 4 / 3).all()


def test_scene_path_takes_hyphens():
    assert scene_path("newtons-cradle") == scene_path("newtons_cradle")
    assert load("newtons-cradle")[0].nq == load(scene_path("newtons_cradle"))[0].nq == 5


@pytest.mark.parametrize("name", ["newton_cradle", "nonsense", ""])
def test_unknown_scene_names_the_nearest(name):
    for call in (scene_path, load):
        with pytest.raises(UnknownNameError, match="unknown scene") as error:
            call(name)
        assert "newtons_cradle" in str(error.value)


@pytest.mark.parametrize("name", [None, 3, b"wedge", ["wedge"]], ids=str)
def test_what_is_no_name_of_a_scene(name):
    for call in (load, scene_path):
        with pytest.raises(UnknownNameError, match="unknown scene"):
            call(name)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("not xml", "parse error"),
        ("", "empty file"),
        ("<foo/>", "foo"),
        ("<mujoco><foo/></mujoco>", "foo"),
        ('<mujoco><worldbody><geom size="-1"/></worldbody></mujoco>', "size 0 must be positive"),
        ('<mujoco><include file="nowhere.xml"/></mujoco>', "nowhere.xml"),
    ],
)
def test_file_that_is_no_scene(tmp_path: Path, text: str, message: str):
    path = tmp_path / "scene.xml"
    path.write_text(text)
    with pytest.raises(SceneError, match=message) as error:
        load(path)
    assert "\n" not in str(error.value)
    assert str(path) in str(error.value)


def test_missing_file_and_directory(tmp_path: Path):
    for missing in (tmp_path / "no.xml", str(tmp_path / "no"), "no.xml", Path("no")):
        with pytest.raises(SceneError, match="no such file"):
            load(missing)
    for folder in (tmp_path, str(tmp_path)):
        with pytest.raises(SceneError, match="is a directory"):
            load(folder)


def test_a_file_that_may_not_be_read(monkeypatch):
    """MuJoCo would call it empty."""
    monkeypatch.setattr("os.access", lambda path, mode: False)  # permissions do not hold for root
    with pytest.raises(SceneError, match="no permission to read"):
        load(scene_path("wedge"))


def test_load_without_start_keeps_the_default(tmp_path: Path):
    path = tmp_path / "free.xml"
    path.write_text(
        '<mujoco><worldbody><body pos="0 0 3"><freejoint/><geom size="1"/></body></worldbody>'
        '<keyframe><key name="other" qpos="0 0 9 1 0 0 0"/></keyframe></mujoco>'
    )
    for given in (path, str(path)):
        np.testing.assert_array_equal(load(given)[1].qpos, [0, 0, 3, 1, 0, 0, 0])


def test_contacts_of_no_position_are_an_error():
    model, data = load("box_drop")
    data.qpos[0] = np.nan
    with pytest.raises(DivergenceError, match="qpos"):
        read_contacts(model, data)

"""Recordings and pictures of the environments."""

import copy
import os
import subprocess
import sys

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from own_envs import IDS, bare, every_env

from impactlaw.envs.rendering import has_display
from impactlaw.errors import RecordingError, RenderError
from impactlaw.recording import read_log
from impactlaw.studies.policies.controllers import CONTROLLERS
from scripts.controllers.__main__ import LAWS

# Recording


@every_env
def test_log(name, tmp_path):
    short = name.removeprefix("impactlaw/")
    law, restitution = LAWS[short][0]
    path = tmp_path / "run.rrd"
    env = gymnasium.make(name, law=law, restitution=restitution, log=str(path), max_episode_steps=120)
    infos = []
    for seed in (7, 8):
        observation, _ = env.reset(seed=seed)
        controller, over = CONTROLLERS[short](), False
        while not over:
            observation, _, terminated, truncated, info = env.step(np.atleast_1d(controller(observation)))
            infos.append(info)
            over = terminated or truncated
    env.close()
    recording = read_log(path)
    assert recording.properties["seed"] == 7
    assert recording.properties["scene"] == name
    time, energy = recording.series("energy/total")
    assert len(time) == 2 + len(infos) * env.unwrapped.frame_skip
    assert np.isfinite(energy).all()
    collisions = recording.collisions
    assert len(collisions) == sum(info["impact/count"] for info in infos) > 0
    for column in ("energy_change", "intensity"):
        np.testing.assert_allclose(
            collisions[column].sum(), sum(info[f"impact/{column}"] for info in infos), rtol=1e-12
        )
    assert sorted(set(collisions["episode"])) == [0, 1]


@every_env
def test_log_that_cannot_be_written(name, tmp_path):
    with pytest.raises(RecordingError, match="nowhere"):
        gymnasium.make(name, log=tmp_path / "nowhere" / "run.rrd")


@every_env
def test_a_copy_does_not_record(name, tmp_path):
    env = gymnasium.make(name, log=tmp_path / "run.rrd")
    env.reset(seed=0)
    copy.deepcopy(env).step(env.action_space.sample())
    env.close()
    assert len(read_log(tmp_path / "run.rrd").series("energy/total")[0]) == 1


# Pictures


def draw(env) -> np.ndarray:
    try:
        picture = env.render()
    except RenderError as error:
        pytest.skip(f"no pictures here: {error}")
    assert isinstance(picture, np.ndarray)
    return picture


@every_env
def test_pictures(name):
    env = bare(name, render_mode="rgb_array", width=320, height=200)
    env.reset(seed=2)
    before = draw(env)
    assert before.shape == (200, 320, 3)
    assert before.dtype == np.uint8
    assert before.std() > 10
    for _ in range(10):
        env.step(np.ones(env.action_space.shape))
    assert np.count_nonzero(draw(env) != before) > 100
    twin = copy.deepcopy(env)
    np.testing.assert_array_equal(draw(twin), draw(env))
    for each in (env, twin):
        each.close()
        each.close()


@every_env
def test_check_env_with_pictures(name):
    env = bare(name, render_mode="rgb_array")
    env.reset(seed=0)
    draw(env)
    check_env(env)


@pytest.mark.skipif(has_display(), reason="there is a display")
@every_env
def test_window_without_display(name):
    with pytest.raises(RenderError, match="no display"):
        gymnasium.make(name, render_mode="human")


@pytest.mark.parametrize(
    ("backend", "message"),
    [("glfw", "MUJOCO_GL=glfw"), ("", "no EGL and no OSMesa")],
    ids=["a library that needs a display", "no library"],
)
def test_no_opengl_is_one_clear_error(monkeypatch, backend, message):
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    monkeypatch.setenv("MUJOCO_GL", backend)
    monkeypatch.setattr("ctypes.util.find_library", lambda name: None)
    env = bare(IDS[0], render_mode="rgb_array")
    env.reset(seed=0)
    with pytest.raises(RenderError, match=message) as raised:
        env.render()
    assert "libegl1 or libosmesa6" in str(raised.value)


def test_pictures_that_are_too_large_are_one_clear_error():
    draw(bare(IDS[0], render_mode="rgb_array"))
    env = bare(IDS[0], render_mode="rgb_array", width=100_000)
    with pytest.raises(RenderError, match=r"cannot draw .*, or make the pictures smaller than 100000 x 480 pixels"):
        env.render()


@pytest.mark.parametrize(
    ("environment", "expected"),
    [({}, {"egl", "osmesa", None}), ({"MUJOCO_GL": "osmesa"}, {"osmesa"}), ({"DISPLAY": ":0"}, {None})],
    ids=["nothing set", "set already", "display"],
)
def test_mujoco_gl_is_set_only_where_needed(environment, expected):
    code = "import os, impactlaw.envs; print(os.environ.get('MUJOCO_GL'))"
    clean = {k: v for k, v in os.environ.items() if k not in ("MUJOCO_GL", "DISPLAY", "WAYLAND_DISPLAY")}
    found = subprocess.run(
        [sys.executable, "-c", code], check=True, env=clean | environment, capture_output=True, text=True
    ).stdout.strip()
    assert found in {str(value) for value in expected}
